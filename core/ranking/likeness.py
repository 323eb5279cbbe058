"""Likeness: the property in which two shapes are alike, in one word.

Registration confirms rigid copies (`core.registration.rigid_copy`). Nearly isometric surfaces have
nearly the same Laplace-Beltrami eigenvalues, and correspond in the spectral domain. The class probability
tells all other pairs apart. Clients import this module, so it imports no arrays.
"""

from typing import Literal

from core.registration.kinship import kinship

Likeness = Literal["same", "scaled", "mirrored", "variant", "pose", "similar", "weak"]
"""The likeness of a second shape to a first one.

same : a rigid copy of the same size, on any mesh.
scaled : a rigid copy of another size.
mirrored : a rigid copy of the mirror image, of any size.
variant : a rigid copy, of any size, but for a local difference.
pose : nearly isometric, as two poses of one body.
similar : probably of one class.
weak : none of these.
"""

NEAR_ISOMETRIC = 0.032
"""Largest spectral distance of two nearly isometric surfaces: the Euclidean distance between the logarithms
of their first 30 Laplace-Beltrami eigenvalues, divided by the root of 30.

A compromise: poses of one body that are further apart are told as similar, and individuals of one class that
are nearer as poses. docs/likeness.md has the shares of both."""

POSE_CC = 0.98
"""Least CC of two nearly isometric surfaces."""

SIMILAR = 0.5
"""Least class probability of two similar shapes: one class is as probable as two."""


def likeness(
    *,
    spectral: float,
    cc: float,
    probability: float,
    scale: float | None,
    mirrored: bool = False,
    variant: bool = False,
) -> Likeness:
    """Return the likeness of a second shape to a first one; its thresholds suit the default setting.

    `spectral` is the distance of their log eigenvalues, >= 0, and `probability` that of one class. If the
    second is a rigid copy or a variant, `scale` is length in it over length in the first; it may be a copy of
    the mirror image, or one but for a local difference.
    """
    if scale is not None:
        return kinship(scale, mirrored=mirrored, variant=variant)
    if spectral <= NEAR_ISOMETRIC and cc >= POSE_CC:
        return "pose"
    return "similar" if probability >= SIMILAR else "weak"
