"""Partial matching: the one-sided distance of spin images from a part of a surface to a whole one.

Each keypoint of the part needs a similar keypoint on the whole; keypoints of the whole may stay unmatched.
The scale of spin images follows from the area of the whole, and the missing share of it is unknown, so a part
is described for several shares.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from core.arrays import Bytes, Floats
from core.descriptors.spin_images import (
    BINS,
    BYTE_SCALE,
    KEYPOINTS,
    RADII,
    SPIN_IMAGE_LENGTH,
    spin_image_count,
    spin_image_distances,
    spin_images,
)
from core.mesh.cleaning import face_areas
from core.mesh.edges import boundary_edges
from core.mesh.mesh import Mesh
from core.parameters import INCOMPLETE

MISSING_SHARES = (0.0, 0.15, 0.3, 0.5, 0.7)
"""Shares of the whole's area that may be missing."""

BOUNDARY_MARGIN = 0.4
"""A support ball is usable if its centre is farther from the boundary than this many of its radii; closer to
the boundary the ball lacks surface that was cut away."""

LEAST_USABLE = 0.1
"""Below this share of usable support balls, all of them are used."""

MOST_BOUNDARY_POINTS = 20_000
"""Largest number of points sampled on the boundary, beside one on each boundary edge."""

BATCH = 4
"""Number of wholes that are compared at a time; it bounds the memory."""

PART_ROWS = sum(spin_image_count(missing) for missing in MISSING_SHARES)
"""Number of rows that describe a part."""

ROW_LENGTH = SPIN_IMAGE_LENGTH + len(RADII)
ROW_COUNTS = {False: KEYPOINTS, True: KEYPOINTS + PART_ROWS}
"""Number of descriptor rows, by whether the surface is incomplete."""


def describe_part(surface: Mesh) -> Bytes:
    """Return the spin images of a surface as a part, for each share of `MISSING_SHARES` after the other.

    The surface is clean, with area > 0 and its boundary loops open. The result is uint8, shape (PART_ROWS,
    SPIN_IMAGE_LENGTH + len(RADII)); its last columns are 1 for each usable support ball of the keypoint.
    """
    boundary = _boundary_points(surface)
    tree = cKDTree(boundary) if len(boundary) else None
    rows = []
    for missing in MISSING_SHARES:
        described = spin_images(surface, missing)
        gaps = np.full(len(described.points), np.inf) if tree is None else tree.query(described.points)[0]
        usable = gaps[:, None] > BOUNDARY_MARGIN * described.unit * np.array(RADII)
        if usable.mean() < LEAST_USABLE:
            usable[:] = True
        rows.append(np.concatenate([described.bytes, usable.astype(np.uint8)], axis=1))
    return np.concatenate(rows)


def _boundary_points(surface: Mesh) -> Floats:
    """Sample points on the boundary edges, dense enough for the smallest support ball, shape (p, 3).

    The edges of a needle are long beside the root of its area; `MOST_BOUNDARY_POINTS` bounds their number.
    """
    start, end = (surface.vertices[ends] for ends in boundary_edges(surface.half_edges).T)
    area = face_areas(surface.vertices, surface.faces).sum()
    lengths = np.linalg.norm(end - start, axis=1)
    step = max(
        0.5 * BOUNDARY_MARGIN * RADII[0] * float(np.sqrt(area)), float(lengths.sum()) / MOST_BOUNDARY_POINTS
    )
    count = np.maximum(np.ceil(lengths / step), 1.0).astype(np.int64)
    edge = np.repeat(np.arange(len(count)), count)
    index = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    along = ((index + 0.5) / count[edge])[:, None]
    return np.asarray(start[edge] + along * (end - start)[edge])


def part_distances(part: Bytes, wholes: Sequence[Bytes]) -> Floats:
    """Compute distances of a part to each of c wholes, by their spin images, shape (c,), >= 0.

    The mean squared distance over the usable support balls, for the missing share that minimises it. It is 0
    for a complete surface and itself; for a part it depends on the cut.

    Parameters
    ----------
    part : uint8, shape (PART_ROWS, SPIN_IMAGE_LENGTH + len(RADII))
        From `describe_part`.
    wholes : sequence of uint8, each of shape (KEYPOINTS, SPIN_IMAGE_LENGTH)
        From `core.descriptors.spin_images.spin_images`.
    """
    images = part[:, :SPIN_IMAGE_LENGTH].astype(np.float32)
    counts = part[:, SPIN_IMAGE_LENGTH:].astype(np.float32)
    weighted = np.repeat(counts, BINS, axis=1) * images
    squares = (weighted * images).sum(axis=1)
    factors = np.concatenate([-2.0 * weighted, counts], axis=1).T
    starts = [0, *accumulate(spin_image_count(missing) for missing in MISSING_SHARES)][:-1]
    balls = np.add.reduceat(counts.sum(axis=1, dtype=np.float64), starts) / len(RADII)
    distances = np.empty(len(wholes))
    for start in range(0, len(wholes), BATCH):
        batch = np.stack(wholes[start : start + BATCH]).astype(np.float32)
        # Over the usable balls |x - y|^2 = |x|^2 - 2 x y + |y|^2, where |x|^2 is added to the minimum.
        ball_squares = (batch**2).reshape(*batch.shape[:2], len(RADII), BINS).sum(axis=3)
        products = np.concatenate([batch, ball_squares], axis=2) @ factors
        least = (products.min(axis=1) + squares).astype(np.float64)
        distances[start : start + len(batch)] = (np.add.reduceat(least, starts, axis=1) / balls).min(axis=1)
    return distances / BYTE_SCALE**2


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
    """Return the spin images of a surface as rows of bytes.

    The first `KEYPOINTS` rows describe the surface as a whole. An incomplete surface, whose boundary ratio is
    above `INCOMPLETE` and whose loops are open, has `PART_ROWS` more rows, which describe it as a part
    (`describe_part`). The surface is clean, with area > 0; the result is uint8, shape (r, ROW_LENGTH).
    """
    whole = np.ones((KEYPOINTS, ROW_LENGTH), dtype=np.uint8)
    whole[:, :SPIN_IMAGE_LENGTH] = spin_images(surface).bytes
    return np.concatenate([whole, describe_part(surface)]) if boundary_ratio > INCOMPLETE else whole


def whole_distances(query: Bytes, others: Sequence[Bytes]) -> Floats:
    """Return the larger of the two one-sided distances of whole surfaces, shape (c,), >= 0."""
    wholes = [whole_spin_images(other) for other in others]
    return np.asarray(spin_image_distances(whole_spin_images(query), wholes).max(axis=1))


def descriptor_distance(query: Bytes, others: Sequence[Bytes], whole: Floats) -> DescriptorDistance:
    """Return descriptor distances of one surface to c others; none depends on the other candidates.

    `whole` are the `whole_distances` of them, shape (c,), which are the distances of complete surfaces.
    """
    part = np.array([is_part(query) or is_part(other) for other in others], dtype=bool)
    distance = np.where(part, np.inf, whole)
    if is_part(query):
        distance = part_distances(query[KEYPOINTS:], [whole_spin_images(other) for other in others])
    for i, other in enumerate(others):
        if is_part(other):
            distance[i] = min(distance[i], part_distances(other[KEYPOINTS:], [whole_spin_images(query)])[0])
    return DescriptorDistance(distance, part)


def is_part(rows: Bytes) -> bool:
    """Return whether the descriptors, from `describe`, belong to an incomplete surface."""
    return len(rows) > KEYPOINTS


def whole_spin_images(rows: Bytes) -> Bytes:
    """Return the spin images of the surface as a whole, shape (KEYPOINTS, SPIN_IMAGE_LENGTH)."""
    return rows[:KEYPOINTS, :SPIN_IMAGE_LENGTH]
