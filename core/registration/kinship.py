"""Kinship of two rigid copies of one shape: of one size, of another size, mirror images, or variants.

This module imports nothing, so that commands and clients that only name kinships start fast.
"""

from typing import Literal

Kinship = Literal["same", "scaled", "mirrored", "variant"]

SIZE = 0.03
"""Two copies have one size if their scale differs from 1 by at most this."""


def kinship(scale: float, *, mirrored: bool, variant: bool = False, size: float = SIZE) -> Kinship:
    """Return the relation of two copies.

    Parameters
    ----------
    scale : float
        Length in the second over length in the first.
    mirrored : bool
        Whether one is a mirror image of the other.
    variant : bool
        Whether they differ locally.
    size : float
        Largest difference of the scale of two copies of one size from 1.
    """
    if variant:
        return "variant"
    if mirrored:
        return "mirrored"
    return "same" if max(scale, 1.0 / scale) <= 1.0 + size else "scaled"
