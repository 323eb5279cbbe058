"""Distances between the embedded points and the samples, by the parameter `distances`."""

import numpy as np
from scipy.sparse import csr_array

from core.arrays import Floats, Ints
from core.graph.geodesics import geodesics
from core.graph.minimum_spanning_tree import tree_distances
from core.graph.sparse_graph import SparseGraph, graph_distances


def sample_distances(graph: csr_array, points: Ints, samples: Ints, sparse: SparseGraph, kind: str) -> Floats:
    """Distances from the d points to the m samples, shape (d, m).

    Distances along the minimum spanning tree or the sparse graph exist between samples only (d = m).

    Parameters
    ----------
    graph : csr_array, shape (n, n)
        The edge graph.
    points : int64, shape (d,)
        Vertices; the samples come first.
    samples : int64, shape (m,)
        Vertices.
    sparse : SparseGraph
        The sparse graph of the samples.
    kind : "tree", "graph" or "geodesic"
        See `core.parameters.SpectralParameters`.
    """
    if kind == "geodesic":
        between = geodesics(graph, samples, points)
        core = between[: len(samples)]
        core[:] = np.minimum(core, core.T)
        return between
    along = tree_distances if kind == "tree" else graph_distances
    return along(sparse, len(samples))
