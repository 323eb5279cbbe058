"""The minimum spanning tree of the samples (Eq. 13, Algorithm 2)."""

import numpy as np
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats
from core.graph.edge_graph import symmetric
from core.graph.sparse_graph import SparseGraph


def tree_distances(graph: SparseGraph, count: int) -> Floats:
    """Path lengths between the samples along the minimum spanning tree, as in the paper, shape (m, m).

    Parameters
    ----------
    graph : SparseGraph
    count : int
        Number of samples m.
    """
    tree = symmetric(graph.edges[graph.tree], graph.lengths[graph.tree], count)
    return np.asarray(dijkstra(tree))
