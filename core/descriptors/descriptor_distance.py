"""Descriptor distance of two surfaces, from their spin images; either may be a part of the other."""

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
"""Number of descriptor rows, by whether the surface is incomplete."""


@dataclass(frozen=True, eq=False)
class DescriptorDistance:
    """Descriptor distances of one surface to c others.

    Attributes
    ----------
    distance : float64, shape (c,)
        Mean squared distance of spin images, >= 0; 0 between a surface and itself. Two complete surfaces: the
        larger of the two one-sided distances. One incomplete surface: the distance from it to the other. Two
        incomplete surfaces: the smaller of the two one-sided distances.
    part : bool, shape (c,)
        Whether one or both surfaces are incomplete.
    """

    distance: Floats
    part: NDArray[np.bool_]


def describe(surface: Mesh, *, boundary_ratio: float) -> Bytes:
    """The spin images of a surface as rows of bytes.

    The first `KEYPOINTS` rows describe the surface as a whole. An incomplete surface has `PART_ROWS` more
    rows, which describe it as a part (`core.descriptors.partial_matching.describe_part`).

    Parameters
    ----------
    surface : Mesh
        Clean, with area > 0. An incomplete surface has its boundary loops open.
    boundary_ratio : float
        As `core.descriptors.boundary_ratio` computes it; above `INCOMPLETE` the surface is incomplete.

    Returns
    -------
    uint8, shape (r, ROW_LENGTH)
        r is `ROW_COUNTS` of whether the surface is incomplete.
    """
    whole = np.ones((KEYPOINTS, ROW_LENGTH), dtype=np.uint8)
    whole[:, :SPIN_IMAGE_LENGTH] = spin_images(surface).bytes
    return np.concatenate([whole, describe_part(surface)]) if boundary_ratio > INCOMPLETE else whole


def descriptor_distance(query: Bytes, others: Sequence[Bytes]) -> DescriptorDistance:
    """Descriptor distances of one surface to c others; no distance depends on the other candidates.

    Parameters
    ----------
    query : uint8, shape (r, ROW_LENGTH)
        Descriptors of the surface, from `describe`.
    others : sequence of uint8, each of shape (r, ROW_LENGTH)
        Descriptors of the candidates.
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
    """Whether the descriptors, from `describe`, belong to an incomplete surface."""
    return len(rows) > KEYPOINTS


def whole_spin_images(rows: Bytes) -> Bytes:
    """The spin images of the surface as a whole, shape (KEYPOINTS, SPIN_IMAGE_LENGTH)."""
    return rows[:KEYPOINTS, :SPIN_IMAGE_LENGTH]
