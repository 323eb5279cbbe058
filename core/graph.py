"""The mesh as a graph, the sparse graph of its samples, and the minimum spanning tree (Algorithm 2)."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree
from scipy.spatial import cKDTree

from core.compiled import compiled
from core.edges import HalfEdges, component_labels, half_edges, starts_of
from core.mesh import Floats, Ints, Mesh
from core.ordering import TIE, settled
from core.radix import lexical_order

ROUNDING = 1e-9
"""Path lengths that differ by less than this part are equal: rounding, which changes with the pose, must not
choose between them. Split edges make many such ties."""

MOST_SHEETS = 6
"""Where more faces than this share an edge, no way leads straight across it."""


@dataclass(frozen=True, eq=False)
class SparseGraph:
    """The samples' graph.

    Attributes
    ----------
    edges : int64, shape (e, 2)
        Pairs of samples whose regions touch, i < j, in lexical order.
    lengths : float64, shape (e,)
        Shortest way through the two regions, d(u) + |uv| + d(v) (Mehlhorn 1988).
    tree : int64, shape (m - 1,)
        Which edges form the minimum spanning tree; of equal ones the first.
    regions: int64, shape (n,)
        The sample nearest to each vertex, by its place among the samples; of equally near ones the first.
    """

    edges: Ints
    lengths: Floats
    tree: Ints
    regions: Ints


def diagonals(vertices: Floats, faces: Ints, sides: HalfEdges | None = None) -> tuple[Ints, Floats]:
    """Straight ways across pairs of neighbouring faces.

    Two faces on an edge are unfolded into a plane; where the segment between their far corners crosses the
    edge it is a true path on the surface. With these in the graph, shortest paths follow twelve directions
    instead of six, and come nearer to the geodesics.

    Returns
    -------
    ends : int64, shape (d, 2)
    lengths : float64, shape (d,)
    """
    sides = sides or half_edges(faces)
    opposite = faces[:, [2, 0, 1]].ravel()[sides.order]
    low, high = sides.low, sides.high
    edge_of = np.repeat(np.arange(len(sides.first)), sides.sheets)
    few = (sides.sheets <= MOST_SHEETS)[edge_of]
    pairs = [np.flatnonzero((edge_of[i:] == edge_of[:-i]) & few[i:]) for i in range(1, MOST_SHEETS)]
    start = np.concatenate(pairs)
    end = np.concatenate([first + i for i, first in enumerate(pairs, start=1)])
    a, b = vertices[low[start]], vertices[high[start]]
    p, q = opposite[start], opposite[end]
    axis = b - a
    edge = np.linalg.norm(axis, axis=1)
    axis = axis / np.where(edge > 0.0, edge, 1.0)[:, None]
    along_p = np.einsum("ni,ni->n", vertices[p] - a, axis)
    along_q = np.einsum("ni,ni->n", vertices[q] - a, axis)
    up_p = np.sqrt(np.maximum(np.einsum("ni,ni->n", vertices[p] - a, vertices[p] - a) - along_p**2, 0.0))
    up_q = np.sqrt(np.maximum(np.einsum("ni,ni->n", vertices[q] - a, vertices[q] - a) - along_q**2, 0.0))
    height = up_p + up_q
    crossing = (along_p * up_q + along_q * up_p) / np.where(height > 0.0, height, 1.0)
    inside = (crossing > TIE * edge) & (crossing < (1.0 - TIE) * edge)
    valid = (height > 0.0) & inside & (p != q)
    lengths = np.hypot(along_p - along_q, height)
    return np.stack([p[valid], q[valid]], axis=1), lengths[valid]


def bridges(vertices: Floats, labels: Ints) -> Ints:
    """Vertex pairs that join all components by their shortest Euclidean gaps, shape (components - 1, 2).

    Boruvka's rounds: each component's nearest vertex outside it. Components differ in some bit of their
    number, so nearest neighbours between the two halves of each bit find it exactly. Of equal gaps that of
    the earliest vertices is taken.
    """
    labels = labels.copy()
    chosen: list[Ints] = []
    everything = cKDTree(vertices)
    number = int(labels.max()) + 1
    while number > 1:
        gap = np.full(len(vertices), np.inf)
        for bit in range((number - 1).bit_length()):
            side = (labels >> bit) & 1 == 1
            for mine, theirs in ((side, ~side), (~side, side)):
                distance = cKDTree(vertices[theirs]).query(vertices[mine])[0]
                gap[mine] = np.minimum(gap[mine], distance)
        rank = settled(np.log(gap))
        order = np.lexsort((rank, labels))
        lead = order[np.unique(labels[order], return_index=True)[1]]
        lead = lead[np.argsort(rank[lead], kind="stable")]
        near = everything.query_ball_point(vertices[lead], gap[lead] * (1.0 + TIE))
        pairs = np.array(
            [[v, min(u for u in ball if labels[u] != labels[v])] for v, ball in zip(lead, near, strict=True)]
        )
        ends = labels[pairs]
        place = np.arange(1, number + 1)
        links = coo_array((place, (ends[:, 0], ends[:, 1])), shape=(number, number)).tocsr()
        tree = minimum_spanning_tree(links.maximum(links.T))
        chosen.append(pairs[np.sort(tree.data.astype(np.int64)) - 1])
        number, group = connected_components(tree, directed=False)
        labels = group.astype(np.int64)[labels]
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *chosen])


def symmetric(edges: Ints, lengths: Floats, count: int) -> csr_array:
    """The graph as a symmetric sparse matrix, shape (count, count); of parallel edges the shortest counts."""
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = lexical_order(low, high)
    low, high = low[order], high[order]
    first = np.flatnonzero(starts_of(low, high))
    low, high, lengths = low[first], high[first], np.minimum.reduceat(lengths[order], first)
    rows, columns = np.concatenate([low, high]), np.concatenate([high, low])
    matrix = coo_array((np.concatenate([lengths, lengths]), (rows, columns)), shape=(count, count)).tocsr()
    matrix.sort_indices()
    return matrix


def edge_graph(mesh: Mesh, labels: Ints | None = None, *, unfold: bool = True) -> csr_array:
    """The graph of the mesh's vertices: edges with their lengths, bridges between loose parts, diagonals.

    Parameters
    ----------
    mesh : Mesh
    labels : int64, shape (n,), optional
        Connected components, when known.
    unfold : bool
        Whether to add `diagonals`; the paper's graph has the edges alone.

    Returns
    -------
    csr_array, shape (n, n), symmetric, connected
    """
    count = len(mesh.vertices)
    sides = half_edges(mesh.faces)
    if labels is None:
        _, labels = component_labels(count, mesh.faces)
    edges = np.concatenate([sides.edges, bridges(mesh.vertices, labels)])
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    if unfold:
        ends, across = diagonals(mesh.vertices, mesh.faces, sides)
        edges, lengths = np.concatenate([edges, ends]), np.concatenate([lengths, across])
    shortest = 1e-12 * float(lengths.max())
    return symmetric(edges, np.maximum(lengths, shortest), count)


@compiled
def _settle_ties(
    indptr: Ints, indices: Ints, lengths: Floats, order: Ints, distance: Floats, region: Ints
) -> None:
    """Move each vertex, the nearest first, to the earliest of the samples that are equally near to it."""
    for v in order:
        for edge in range(indptr[v], indptr[v + 1]):
            u = indices[edge]
            way = distance[u] + lengths[edge]
            if distance[u] < distance[v] and way <= distance[v] * (1.0 + ROUNDING) and region[u] < region[v]:
                region[v] = region[u]


def sparse_graph(graph: csr_array, samples: Ints) -> SparseGraph:
    """The samples' graph and its minimum spanning tree, by one multi-source Dijkstra.

    Every vertex learns its nearest sample; an edge (u, v) between two regions proposes a sample-sample edge
    of length d(u) + |uv| + d(v). The minimum spanning tree of the proposals is one of the complete geodesic
    graph on the samples (Mehlhorn 1988).

    Parameters
    ----------
    graph : csr_array, shape (n, n)
        Symmetric and connected.
    samples : int64, shape (m,)
        Distinct vertices.
    """
    distance, _, source = dijkstra(graph, indices=samples, min_only=True, return_predecessors=True)
    number = np.full(graph.shape[0], -1, dtype=np.int64)
    number[samples] = np.arange(len(samples))
    region = number[source]
    _settle_ties(graph.indptr, graph.indices, graph.data, np.argsort(distance), distance, region)
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
    shortest_first = np.argsort(settled(lengths, ROUNDING), kind="stable")
    place = np.empty(len(edges), dtype=np.int64)
    place[shortest_first] = np.arange(1, len(edges) + 1)
    tree = minimum_spanning_tree(csr_array((place, edges.T), shape=proposals.shape))
    return SparseGraph(
        edges, lengths, tree=np.sort(shortest_first[tree.data.astype(np.int64) - 1]), regions=region
    )


def tree_distances(graph: SparseGraph, count: int) -> Floats:
    """Path lengths between the samples along the minimum spanning tree, shape (m, m): the paper's reading."""
    tree = symmetric(graph.edges[graph.tree], graph.lengths[graph.tree], count)
    return np.asarray(dijkstra(tree))


def graph_distances(graph: SparseGraph, count: int) -> Floats:
    """Path lengths between the samples along the sparse graph, shape (m, m)."""
    return np.asarray(dijkstra(symmetric(graph.edges, graph.lengths, count)))
