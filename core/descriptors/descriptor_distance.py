"""How far two surfaces are apart by what lies about their points, where either may be a part of the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Floats
from core.descriptors.completeness import INCOMPLETE
from core.descriptors.partial_matching import PART_ROWS, describe_part, part_distances
from core.descriptors.spin_images import (
    KEYPOINTS,
    RADII,
    SPIN_IMAGE_LENGTH,
    spin_image_distances,
    spin_images,
)
from core.mesh.mesh import Mesh

ROW_LENGTH = SPIN_IMAGE_LENGTH + len(RADII)
ROW_COUNTS = {False: KEYPOINTS, True: KEYPOINTS + PART_ROWS}
"""How many rows a complete and an incomplete surface have."""


@dataclass(frozen=True, eq=False)
class DescriptorDistance:
    """How far one surface is from each of c others: arrays of shape (c,).

    Attributes
    ----------
    distance : float64
        Mean squared distance of patches, >= 0; 0 between a surface and itself. Of two complete surfaces, the
        larger of those from either to the other; else from an incomplete one to the other, and the smaller
        where both are.
    part : bool
        Where one or both are incomplete.
    """

    distance: Floats
    part: NDArray[np.bool_]


def describe(surface: Mesh, *, boundary_ratio: float) -> Bytes:
    """A surface as rows of bytes: its patches as a whole, and behind them, if it is incomplete, as a part.

    Parameters
    ----------
    surface : Mesh
        Clean, with some area; if it is incomplete, its open edges are its rim.
    openness : float
        Of `core.descriptors.boundary_ratio`; incomplete is what has more than `INCOMPLETE`.

    Returns
    -------
    uint8, shape (r, ROW_LENGTH)
        `ROW_COUNTS` says how many.
    """
    whole = np.ones((KEYPOINTS, ROW_LENGTH), dtype=np.uint8)
    whole[:, :SPIN_IMAGE_LENGTH] = spin_images(surface).bytes
    return np.concatenate([whole, describe_part(surface)]) if boundary_ratio > INCOMPLETE else whole


def descriptor_distance(query: Bytes, others: Sequence[Bytes]) -> DescriptorDistance:
    """The distances of one surface from c others, each the same whatever others there are.

    Parameters
    ----------
    query : uint8, shape (r, ROW_LENGTH)
        As `described` gives it.
    others : sequence of uint8, each of shape (r, ROW_LENGTH)
    """
    distance = np.full(len(others), np.inf)
    part = np.array([is_part(query) or is_part(other) for other in others], dtype=bool)
    if is_part(query):
        distance = part_distances(query[KEYPOINTS:], [whole_spin_images(other) for other in others])
    else:
        complete = np.flatnonzero(~part).tolist()
        distance[complete] = spin_image_distances(
            whole_spin_images(query), [whole_spin_images(others[i]) for i in complete]
        ).max(axis=1)
    for i, other in enumerate(others):
        if is_part(other):
            distance[i] = min(distance[i], part_distances(other[KEYPOINTS:], [whole_spin_images(query)])[0])
    return DescriptorDistance(distance, part)


def is_part(rows: Bytes) -> bool:
    """Whether a surface, as `described` gives it, is incomplete."""
    return len(rows) > KEYPOINTS


def whole_spin_images(rows: Bytes) -> Bytes:
    """Its patches as a whole, shape (KEYPOINTS, SPIN_IMAGE_LENGTH)."""
    return rows[:KEYPOINTS, :SPIN_IMAGE_LENGTH]
