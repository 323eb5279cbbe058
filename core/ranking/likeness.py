"""Likeness: the property in which two shapes are alike, in one word.

Registration confirms rigid copies (`core.registration.rigid_copy`). Nearly isometric surfaces have
nearly the same Laplace-Beltrami eigenvalues, and correspond in the spectral domain. The class probability
tells all other pairs apart. Clients import this module, so it imports no arrays.
"""

from typing import Literal

Likeness = Literal["same", "scaled", "mirrored", "variant", "part_of", "pose", "similar", "weak"]
"""The likeness of a second shape to a first one.

same : a rigid copy of the same size, on any mesh.
scaled : a rigid copy of another size.
mirrored : a rigid copy of the mirror image, of any size.
variant : a rigid copy, of any size, but for a local difference.
part_of : one of the two has several pieces, of which some are copies of the other.
pose : nearly isometric and bent, as two poses of one body.
similar : probably of one class.
weak : none of these.
"""

Copy = Literal["same", "scaled", "mirrored", "variant"]
"""The likeness of a rigid copy, or of a variant."""

SAME_SIZE = 0.03
"""Two copies have one size if their scale differs from 1 by at most this."""

TOLD_SIZE = 0.001
"""Words tell the scale of a copy that differs from 1 by more than this."""

NEAR_ISOMETRIC = 0.07
"""Largest `core.ranking.isometry.isometry_distance` of two nearly isometric surfaces.

A compromise: poses of one body that are further apart are told as similar, and individuals of one class that
are nearer as poses. docs/likeness.md has the shares of both."""

POSE_CC = 0.96
"""Least CC of two nearly isometric surfaces."""

BENT, STRETCHED = 0.055, 1.6
"""Least distance of corresponding samples after the best similarity transform
(`core.registration.similarity.bend`), over the root of the area, of two poses of one body, beyond `STRETCHED`
times their isometry distance: parts of other proportions are no copies for the reason that makes them not
isometric."""

SIMILAR = 0.5
"""Least class probability of two similar shapes: one class is as probable as two."""


def copy_likeness(scale: float, *, mirrored: bool, variant: bool = False) -> Copy:
    """Return the likeness of a copy; `scale` is length in the second over length in the first."""
    if variant:
        return "variant"
    if mirrored:
        return "mirrored"
    return "same" if max(scale, 1.0 / scale) <= 1.0 + SAME_SIZE else "scaled"


def size_is_told(scale: float) -> bool:
    """Return whether words tell the scale of a copy: its size differs."""
    return max(scale, 1.0 / scale) > 1.0 + TOLD_SIZE


def may_be_pose(isometry: float, cc: float) -> bool:
    """Return whether isometry distance, or the spectral distance, which is no larger, and CC allow a pose."""
    return isometry <= NEAR_ISOMETRIC and cc >= POSE_CC


def least_bend(isometry: float) -> float:
    """Return the least bend, over the root of the area, of two poses of one body with an isometry distance.

    Surfaces that are not nearly isometric count as if they were just so.
    """
    return BENT + STRETCHED * min(isometry, NEAR_ISOMETRIC)


def likeness(
    *,
    probability: float,
    scale: float | None = None,
    mirrored: bool = False,
    variant: bool = False,
    part: bool = False,
    pose: bool = False,
) -> Likeness:
    """Return the likeness of a second shape to a first one; its thresholds suit the default setting.

    `probability` is that of one class. `scale`, length in the second over length in the first, is None unless
    registration found a copy; `mirrored` and `variant` tell its kind. `part` tells whether pieces of one are
    copies of the other, and `pose` whether the surfaces are nearly isometric (`may_be_pose`) and bent
    (`least_bend`).
    """
    if scale is not None:
        return copy_likeness(scale, mirrored=mirrored, variant=variant)
    if part:
        return "part_of"
    if pose:
        return "pose"
    return "similar" if probability >= SIMILAR else "weak"
