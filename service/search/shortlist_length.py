"""The length of a shortlist, which has shapes near by signatures and shapes near by view signatures."""

import math

VIEW_SHARE = 0.5
"""Shapes near by view signatures, for each one near by signatures."""


def views_of(length: int) -> int:
    """The number of shapes near by view signatures beside `length` near by signatures."""
    return math.ceil(VIEW_SHARE * length)
