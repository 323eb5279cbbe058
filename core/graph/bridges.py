"""Bridges: the shortest gaps that join all components of a mesh, by the algorithm of Boruvka."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.graph.component_gaps import earliest_outside, update_gaps
from core.graph.point_tree import point_tree
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE, tied_ranks
from core.numerics.compilation import compiled, constant


def component_bridges(mesh: Mesh) -> Ints:
    """The `bridges` between the connected components of a mesh, shape (components - 1, 2)."""
    return bridges(mesh.vertices, component_labels(len(mesh.vertices), mesh.faces)[1])


def bridges(vertices: Floats, labels: Ints) -> Ints:
    """Vertex pairs that join all components by the shortest Euclidean gaps, shape (components - 1, 2).

    The algorithm of Boruvka: in each round every component is joined to the nearest vertex outside it. The
    earliest vertices break ties; gaps within rounding of zero are equal.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
        At two places or more.
    labels : int64, shape (n,)
        Connected component of each vertex, 0 .. components - 1.
    """
    count, number = len(vertices), int(labels.max()) + 1
    chosen = [np.empty((0, 2), dtype=np.int64)]
    if number == 1:
        return chosen[0]
    tree = point_tree(vertices)
    smallest = TIE * (tree.boxes[1, 3:] - tree.boxes[1, :3]).max()
    nearest, distances = np.full(count, -1), np.empty(count)
    while number > 1:
        labels = constant(labels)
        update_gaps(tree, labels, nearest, distances)
        gaps = np.maximum(distances, smallest)
        rank = tied_ranks(np.log(gaps))
        # The first vertex of the lowest rank in each component.
        first = np.full(number, count * count)
        np.minimum.at(first, labels, rank * count + np.arange(count))
        lead = first % count
        lead = lead[np.argsort(rank[lead], kind="stable")]
        other = earliest_outside(tree, labels, vertices[lead], labels[lead], gaps[lead] * (1.0 + TIE))
        pairs = np.stack([lead, other], axis=1)
        ends = labels[pairs]
        kept = _spanning_forest(ends)
        chosen.append(pairs[kept])
        number, group = component_labels(number, ends[kept])
        labels = group[labels]
    return np.concatenate(chosen)


@compiled
def _spanning_forest(links: Ints) -> NDArray[np.bool_]:
    """Which links make a spanning forest (Kruskal 1956), shape (c,).

    Two components may each link to the other, by other vertices where gaps are equal: the later link stays.

    Parameters
    ----------
    links : int64, shape (c, 2)
        One from each component to another, the preferred first.
    """
    place, root = np.empty(len(links), dtype=np.int64), np.arange(len(links))
    kept = np.zeros(len(links), dtype=np.bool_)
    for i in range(len(links)):
        place[links[i, 0]] = i
    for i in range(len(links)):
        a, b = links[i]
        back = place[b]
        if back > i and links[back, 1] == a:
            continue
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        while root[b] != b:
            root[b] = root[root[b]]
            b = root[b]
        root[b] = a
        kept[i] = a != b
    return kept
