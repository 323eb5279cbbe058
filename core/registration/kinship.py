"""Kinship of two rigid copies of one shape: of one size, of another size, mirror images, or variants.

This module imports nothing, so that commands and clients that only name kinships start fast.
"""

from typing import Literal

Kinship = Literal["same", "scaled", "mirrored", "variant"]

SIZE = 0.03
"""Two copies have one size if their scale differs from 1 by at most this."""


def kinship(scale: float, *, mirrored: bool, variant: bool = False, size: float = SIZE) -> Kinship:
    """Return the relation of two copies; one may be a mirror image, or a variant of local differences.

    `scale` is length in the second over length in the first; it differs from 1 by at most `size` for two
    copies of one size.
    """
    if variant:
        return "variant"
    if mirrored:
        return "mirrored"
    return "same" if max(scale, 1.0 / scale) <= 1.0 + size else "scaled"
