"""Bridges: the shortest gaps that join all components of a mesh, by the algorithm of Boruvka."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE, tied_ranks


def component_bridges(mesh: Mesh) -> Ints:
    """The `bridges` between the connected components of a mesh, shape (components - 1, 2)."""
    return bridges(mesh.vertices, component_labels(len(mesh.vertices), mesh.faces)[1])


def bridges(vertices: Floats, labels: Ints) -> Ints:
    """Vertex pairs that join all components by the shortest Euclidean gaps, shape (components - 1, 2).

    The algorithm of Boruvka: in each round every component is joined to the nearest vertex outside it. Two
    components differ in some bit of their labels, so nearest-neighbour queries between the two halves of each
    bit are exact. The earliest vertices break ties; gaps within rounding of zero are equal.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
        At two places or more.
    labels : int64, shape (n,)
        Connected component of each vertex, 0 .. components - 1.
    """
    labels = labels.copy()
    chosen: list[Ints] = []
    everything = cKDTree(vertices)
    smallest = TIE * np.ptp(vertices, axis=0).max()
    number = int(labels.max()) + 1
    while number > 1:
        gap = np.full(len(vertices), np.inf)
        for bit in range((number - 1).bit_length()):
            side = (labels >> bit) & 1 == 1
            for mine, theirs in ((side, ~side), (~side, side)):
                distance = cKDTree(vertices[theirs]).query(vertices[mine])[0]
                gap[mine] = np.minimum(gap[mine], distance)
        gap = np.maximum(gap, smallest)
        rank = tied_ranks(np.log(gap))
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
