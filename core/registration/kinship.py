"""Kinship of two rigid copies of one shape: of one size, of another size, or mirror images.

This module imports nothing, so that commands and clients that only name kinships start fast.
"""

from typing import Literal

Kinship = Literal["same", "scaled", "mirrored"]

SIZE = 0.03
"""Two copies have one size if their scale differs from 1 by at most this."""


def kinship(scale: float, *, mirrored: bool, size: float = SIZE) -> Kinship:
    """Relation of two copies, from their relative scale and from whether one is a mirror image."""
    if mirrored:
        return "mirrored"
    return "same" if max(scale, 1.0 / scale) <= 1.0 + size else "scaled"
