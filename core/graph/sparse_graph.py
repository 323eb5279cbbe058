"""The sparse graph of the samples, its minimum spanning tree (Eq. 13, Algorithm 2), and distances on both."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from core.arrays import Floats, Ints
from core.graph.edge_graph import symmetric
from core.graph.geodesics import geodesics
from core.mesh.ordering import tied_ranks
from core.numerics.compilation import compiled

ROUNDING = 1e-9
"""Path lengths are equal if they differ by less than this fraction: rounding, which changes with the pose,
must not decide between them. Subdivision makes many such ties."""


@dataclass(frozen=True, eq=False)
class SparseGraph:
    """The sparse graph on m samples of n vertices.

    `edges`, shape (e, 2), are pairs (i, j) of samples with adjacent Voronoi regions, i < j, in lexical order;
    `lengths`, shape (e,), the shortest paths through the two regions, d(u) + |uv| + d(v) (Mehlhorn 1988).
    `tree`, shape (m - 1,), has the indices of the edges of the minimum spanning tree, and `regions`, shape
    (n,), that of the sample nearest to each vertex; ties go to the first edge, or sample.
    """

    edges: Ints
    lengths: Floats
    tree: Ints
    regions: Ints


@compiled
def _settle_ties(
    indptr: Ints, indices: Ints, lengths: Floats, order: Ints, distance: Floats, region: Ints
) -> None:
    """Assign each vertex, in order of distance, to the first of the samples that are equally near."""
    for v in order:
        for edge in range(indptr[v], indptr[v + 1]):
            u = indices[edge]
            way = distance[u] + lengths[edge]
            if distance[u] < distance[v] and way <= distance[v] * (1.0 + ROUNDING) and region[u] < region[v]:
                region[v] = region[u]


def sparse_graph(graph: csr_array, samples: Ints) -> SparseGraph:
    """Return the samples' sparse graph and minimum spanning tree, by one multi-source Dijkstra search.

    The search gives the nearest sample of each vertex. An edge (u, v) between two regions gives an edge
    between their samples of length d(u) + |uv| + d(v), and the shortest of these is kept. The minimum
    spanning tree of this graph is one of the complete geodesic graph on the samples (Mehlhorn 1988). The
    graph is symmetric and connected, with positive lengths; the samples are distinct vertices.
    """
    # The nearest sample of each vertex.
    distance, _, source = dijkstra(graph, indices=samples, min_only=True, return_predecessors=True)
    number = np.full(graph.shape[0], -1, dtype=np.int64)
    number[samples] = np.arange(len(samples))
    region = number[source]
    _settle_ties(graph.indptr, graph.indices, graph.data, np.argsort(distance), distance, region)
    # Edges between regions propose edges between their samples.
    links = graph.tocoo()
    between = region[links.row] < region[links.col]
    u, v = links.row[between], links.col[between]
    proposals = symmetric(
        np.stack([region[u], region[v]], axis=1),
        distance[u] + links.data[between] + distance[v],
        len(samples),
    )
    upper = proposals.tocoo()
    half = upper.row < upper.col
    edges = np.stack([upper.row[half], upper.col[half]], axis=1).astype(np.int64)
    lengths = upper.data[half]
    # Ranks in place of lengths: ties within rounding go to the first edge.
    shortest_first = np.argsort(tied_ranks(lengths, ROUNDING), kind="stable")
    rank = np.empty(len(edges), dtype=np.int64)
    rank[shortest_first] = np.arange(1, len(edges) + 1)
    tree = minimum_spanning_tree(csr_array((rank, edges.T), shape=proposals.shape))
    return SparseGraph(
        edges, lengths, tree=np.sort(shortest_first[tree.data.astype(np.int64) - 1]), regions=region
    )


def sample_distances(graph: csr_array, points: Ints, samples: Ints, sparse: SparseGraph, kind: str) -> Floats:
    """Return the distances from the d points to the m samples, shape (d, m).

    Distances along the minimum spanning tree (the paper) or the sparse graph exist between samples only
    (d = m). Points and samples are vertices of the edge graph; the samples come first among the points.
    """
    if kind == "geodesic":
        between = geodesics(graph, samples, points)
        core = between[: len(samples)]
        core[:] = np.minimum(core, core.T)
        return between
    kept = sparse.tree if kind == "tree" else slice(None)
    return np.asarray(dijkstra(symmetric(sparse.edges[kept], sparse.lengths[kept], len(samples))))
