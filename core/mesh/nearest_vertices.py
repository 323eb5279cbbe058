"""The vertices of a mesh nearest to a few points."""

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled, constant

MOST_IN_TREE = 200_000
"""Largest number of vertices in a search tree. Where vertices coincide, the tree takes any one of them, and
the embeddings of smaller meshes keep its choice."""


def nearest_vertices(vertices: Floats, points: Floats) -> Ints:
    """The vertex nearest to each point, shape (p,).

    The tree of a million vertices takes twenty times as long to build as their distances to a hundred points.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
    points : float64, shape (p, 3)
    """
    if len(vertices) <= MOST_IN_TREE:
        return np.asarray(cKDTree(vertices).query(points)[1])
    return _first_nearest(constant(vertices), constant(points.T))


@compiled
def _first_nearest(vertices: Floats, columns: Floats) -> Ints:
    """The first vertex of least distance from each point, given as columns, shape (3, p)."""
    least = np.full(columns.shape[1], np.inf)
    nearest = np.zeros(columns.shape[1], dtype=np.int64)
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        for p in range(columns.shape[1]):
            square = (columns[0, p] - x) ** 2 + (columns[1, p] - y) ** 2 + (columns[2, p] - z) ** 2
            if square < least[p]:
                least[p], nearest[p] = square, v
    return nearest
