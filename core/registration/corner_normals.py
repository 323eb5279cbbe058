"""Normals at the corners of triangles: those of the smooth surface that the triangles approximate."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Floats, Ints

TINY = float(np.finfo(np.float64).tiny)

POWER = 2.0
"""Power of the area of a facet in its weight: a plane gives the normal at its border to a fillet."""


def edge_lengths(corners: Floats) -> Floats:
    """Lengths of the edges of triangles, shape (f, 3)."""
    return np.asarray(np.linalg.norm(corners[:, [1, 2, 0]] - corners, axis=2))


def corner_normals(
    faces: Ints, corners: Floats, flat: Floats, facets: Floats, one: Ints, other: Ints
) -> Floats:
    """Means of the normals of the triangles around each corner, up to sharp edges, weighted by their angles.

    Parameters
    ----------
    faces : int64, shape (f, 3)
    corners : float64, shape (f, 3, 3)
    flat : float64, shape (f, 3)
    one, other : int64, shape (e,)
        The two half-edges of each smooth edge.
    """
    # Half-edge 3 f + i starts at corner i of its face and ends at corner i + 1.
    ahead_one, ahead_other = one - one % 3 + (one + 1) % 3, other - other % 3 + (other + 1) % 3
    corner_of = faces.ravel()
    crossed = corner_of[one] == corner_of[other]
    joined = np.where(crossed, other, ahead_other), np.where(crossed, ahead_other, other)
    rows, columns = np.concatenate([one, ahead_one]), np.concatenate(joined)
    size = 3 * len(faces)
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(size, size))
    count, group = connected_components(graph, directed=False)
    sides = corners[:, [1, 2, 0]] - corners
    lengths = np.maximum(edge_lengths(corners), TINY)
    products = np.einsum("fcx,fcx->fc", sides, sides[:, [2, 0, 1]])
    cosines = -products / (lengths * lengths[:, [2, 0, 1]])
    weights = np.arccos(np.clip(cosines, -1.0, 1.0)) * (facets**POWER)[:, None]
    weighted = np.repeat(flat, 3, axis=0) * weights.reshape(-1, 1)
    sums: Floats = np.stack(
        [np.bincount(group, weights=weighted[:, x], minlength=count) for x in range(3)], axis=1
    )
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), TINY)
    return np.asarray(sums[group].reshape(-1, 3, 3))
