"""How far two surfaces are apart by what lies about their points, where either may be a part of the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Floats
from core.descriptors.boundary_ratio import INCOMPLETE
from core.descriptors.partial_matching import PART_POINTS, part_distances, part_of
from core.descriptors.spin_images import KEYS, LENGTH, RADII, between, spin_images
from core.mesh.mesh import Mesh

WIDTH = LENGTH + len(RADII)
ROWS = {False: KEYS, True: KEYS + PART_POINTS}
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
    uint8, shape (r, WIDTH)
        `ROWS` says how many.
    """
    whole = np.ones((KEYS, WIDTH), dtype=np.uint8)
    whole[:, :LENGTH] = spin_images(surface).bytes
    return np.concatenate([whole, part_of(surface)]) if boundary_ratio > INCOMPLETE else whole


def descriptor_distance(query: Bytes, others: Sequence[Bytes]) -> DescriptorDistance:
    """The distances of one surface from c others, each the same whatever others there are.

    Parameters
    ----------
    query : uint8, shape (r, WIDTH)
        As `described` gives it.
    others : sequence of uint8, each of shape (r, WIDTH)
    """
    distance = np.full(len(others), np.inf)
    part = np.array([is_part(query) or is_part(other) for other in others], dtype=bool)
    if is_part(query):
        distance = part_distances(query[KEYS:], [as_whole(other) for other in others])
    else:
        complete = np.flatnonzero(~part).tolist()
        distance[complete] = between(as_whole(query), [as_whole(others[i]) for i in complete]).max(axis=1)
    for i, other in enumerate(others):
        if is_part(other):
            distance[i] = min(distance[i], part_distances(other[KEYS:], [as_whole(query)])[0])
    return DescriptorDistance(distance, part)


def is_part(rows: Bytes) -> bool:
    """Whether a surface, as `described` gives it, is incomplete."""
    return len(rows) > KEYS


def as_whole(rows: Bytes) -> Bytes:
    """Its patches as a whole, shape (KEYS, LENGTH)."""
    return rows[:KEYS, :LENGTH]
