"""Part in whole: how well a part of a surface is found again on another, by what lies about its points.

Distances are one-sided: each of the part's points needs a like one on the whole, and the whole's may have
none. How much of the whole is missing, and so how large it is, is not known: several shares are tried.
"""

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Bytes, Floats
from core.descriptors.spin_images import (
    BINS,
    BYTE_SCALE,
    RADII,
    SPIN_IMAGE_LENGTH,
    spin_image_count,
    spin_images,
)
from core.mesh.cleaning import face_areas
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh

MISSING_SHARES = (0.0, 0.15, 0.3, 0.5, 0.7)
"""Shares of the area that may be gone."""

BOUNDARY_MARGIN = 0.4
"""A ball counts if its centre is farther than so many of its radii from the open rim: the others lack what
was cut away."""

LEAST_USABLE = 0.1
"""Where fewer balls count than this share of them, all do."""

MOST_BOUNDARY_POINTS = 20_000

BATCH = 4
"""How many wholes are compared at a time."""

PART_ROWS = sum(spin_image_count(missing) for missing in MISSING_SHARES)
"""Rows of a part."""


def describe_part(surface: Mesh) -> Bytes:
    """A surface as a part, for each share of `MISSING_SHARES`.

    Parameters
    ----------
    surface : Mesh
        Clean, with some area; its rims are its open edges.

    Returns
    -------
    uint8, shape (PATCHES, SPIN_IMAGE_LENGTH + len(RADII))
        The patches for one share after those for another, and behind each patch 1 for each of its balls that
        counts, else 0.
    """
    rim = _boundary_points(surface)
    tree = cKDTree(rim) if len(rim) else None
    made = []
    for missing in MISSING_SHARES:
        found = spin_images(surface, missing)
        away = np.full(len(found.points), np.inf) if tree is None else tree.query(found.points)[0]
        counts = away[:, None] > BOUNDARY_MARGIN * found.unit * np.array(RADII)
        if counts.mean() < LEAST_USABLE:
            counts[:] = True
        made.append(np.concatenate([found.bytes, counts.astype(np.uint8)], axis=1))
    return np.concatenate(made)


def _boundary_points(surface: Mesh) -> Floats:
    """Points along the open edges, so close that no ball misses them, shape (p, 3).

    Of a needle, whose edges are long beside the root of its area, at most `MOST_BOUNDARY_POINTS` beside one an edge.
    """
    sides = half_edges(surface.faces)
    start, end = (surface.vertices[ends] for ends in sides.edges[sides.face_counts == 1].T)
    area = face_areas(surface.vertices, surface.faces).sum()
    lengths = np.linalg.norm(end - start, axis=1)
    step = max(
        0.5 * BOUNDARY_MARGIN * RADII[0] * float(np.sqrt(area)), float(lengths.sum()) / MOST_BOUNDARY_POINTS
    )
    count = np.maximum(np.ceil(lengths / step), 1.0).astype(np.int64)
    edge = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    along = ((place + 0.5) / count[edge])[:, None]
    return np.asarray(start[edge] + along * (end - start)[edge])


def part_distances(part: Bytes, wholes: Sequence[Bytes]) -> Floats:
    """How far the patches of a part are from the nearest of each of c wholes, shape (c,), >= 0.

    The mean squared distance over the balls that count, for the share of missing area that makes it least. It
    is 0 for the whole itself; how much it is for a part hangs on how it was cut.

    Parameters
    ----------
    part : uint8, shape (PATCHES, SPIN_IMAGE_LENGTH + len(RADII))
        As `describe_part` gives it.
    wholes : sequence of uint8, each of shape (KEYS, SPIN_IMAGE_LENGTH)
        As `core.descriptors.spin_images.patches` gives them.
    """
    own = part[:, :SPIN_IMAGE_LENGTH].astype(np.float32)
    counts = part[:, SPIN_IMAGE_LENGTH:].astype(np.float32)
    weights = np.repeat(counts, BINS, axis=1)
    weighted = weights * own
    squares = (weighted * own).sum(axis=1)
    starts = [0, *accumulate(spin_image_count(missing) for missing in MISSING_SHARES)][:-1]
    balls = np.add.reduceat(counts.sum(axis=1, dtype=np.float64), starts) / len(RADII)
    found = np.empty(len(wholes))
    for start in range(0, len(wholes), BATCH):
        some = np.stack(wholes[start : start + BATCH]).astype(np.float32)
        flat = some.reshape(-1, SPIN_IMAGE_LENGTH)
        descriptor_distance = squares + flat**2 @ weights.T - 2.0 * (flat @ weighted.T)
        least = descriptor_distance.reshape(*some.shape[:2], -1).min(axis=1).astype(np.float64)
        found[start : start + len(some)] = (np.add.reduceat(least, starts, axis=1) / balls).min(axis=1)
    return found / BYTE_SCALE**2
