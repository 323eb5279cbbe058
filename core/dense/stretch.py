"""Local stretch of a map between two surfaces."""

import numpy as np
from scipy.sparse import csr_array

from core.arrays import Floats, Ints
from core.mesh.mesh import Mesh

_LEAST = 1e-3
"""Smallest ratio of lengths: below it a neighbourhood is mapped to a point."""


def neighbourhoods(mesh: Mesh) -> csr_array:
    """Which vertices are at most two edges apart, shape (n, n), 1 where they are; none is next to itself."""
    edges = mesh.half_edges.edges
    count = len(mesh.vertices)
    one = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    one = one + one.T
    two = csr_array(one + one @ one)
    two.setdiag(0.0)
    two.eliminate_zeros()
    two.data[:] = 1.0
    return two


def stretch(first: Mesh, second: Mesh, there: Ints) -> Floats:
    """How much a map lengthens each neighbourhood of a surface, over the median.

    Of each vertex and its neighbours up to two edges away, the root of the summed squared distances after the
    map over that before it; the mean of its logarithm over the neighbourhood is returned, since the nearest
    vertex is known to half an edge only.

    Parameters
    ----------
    first, second : Mesh
        Of n and m vertices.
    there : int64, shape (n,)
        The vertex of the second surface for each vertex of the first.

    Returns
    -------
    float64, shape (n,)
        Length after over length before, over its median; > 0.
    """
    near = neighbourhoods(first).tocoo()
    rows, columns = near.coords
    mapped = second.vertices[there]
    count = len(first.vertices)

    def squares(points: Floats) -> Floats:
        return np.bincount(rows, ((points[rows] - points[columns]) ** 2).sum(axis=1), count).astype(
            np.float64
        )

    before, after = squares(first.vertices), squares(mapped)
    ratio = np.log(np.maximum(np.sqrt(after / np.maximum(before, np.finfo(float).tiny)), _LEAST))
    valence = np.bincount(rows, minlength=count)
    mean = (ratio + np.bincount(rows, ratio[columns], count)) / (1 + valence)
    return np.asarray(np.exp(mean - np.median(mean)))
