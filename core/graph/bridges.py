"""Bridges: the shortest gaps that join all components of a mesh, by Boruvka's algorithm and a k-d tree."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.box_tree import LEAF, box_tree, earliest_outside, update_gaps
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE, tied_ranks
from core.numerics.compilation import constant


def component_bridges(mesh: Mesh) -> Ints:
    """Return the `bridges` between the connected components of a mesh, shape (components - 1, 2)."""
    return bridges(mesh.vertices, component_labels(len(mesh.vertices), mesh.faces)[1])


def bridges(vertices: Floats, labels: Ints) -> Ints:
    """Return vertex pairs that join all components by the shortest gaps, shape (components - 1, 2).

    The algorithm of Boruvka: in each round every component is joined to the nearest vertex outside it. The
    earliest vertices break ties; gaps within rounding of zero are equal. `vertices`, shape (n, 3), are at two
    places or more; `labels`, shape (n,), have the component of each, 0 .. components - 1.
    """
    count, number = len(vertices), int(labels.max()) + 1
    chosen = [np.empty((0, 2), dtype=np.int64)]
    if number == 1:
        return chosen[0]
    vertices = constant(vertices)
    order = cKDTree(vertices, leafsize=LEAF).indices.astype(np.int64)
    boxes = box_tree(vertices[:, None], order)
    smallest = TIE * (boxes[0, 1] - boxes[0, 0]).max()
    nearest, distances = np.full(count, -1), np.empty(count)
    while number > 1:
        labels = constant(labels)
        update_gaps(vertices, order, boxes, labels, nearest, distances)
        gaps = np.maximum(distances, smallest)
        rank = tied_ranks(np.log(gaps))
        # The first vertex of the lowest rank in each component.
        first = np.full(number, count * count)
        np.minimum.at(first, labels, rank * count + np.arange(count))
        lead = first % count
        lead = lead[np.argsort(rank[lead], kind="stable")]
        outside = earliest_outside(vertices, order, boxes, labels, lead, gaps[lead] * (1.0 + TIE))
        pairs = np.stack([lead, outside], axis=1)
        ends = labels[pairs]
        kept = _spanning_forest(ends, number)
        chosen.append(pairs[kept])
        number, group = component_labels(number, ends[kept])
        labels = group[labels]
    return np.concatenate(chosen)


def _spanning_forest(links: Ints, number: int) -> Ints:
    """Return which links make a spanning forest, ascending (Kruskal 1956).

    There is a link from each component to another, the preferred first, shape (c, 2). Two components may each
    link to the other, by other vertices where gaps are equal: the later link stays.
    """
    low, high = np.sort(links[::-1], axis=1).T
    last = len(links) - 1 - np.unique(low * number + high, return_index=True)[1]
    ends = np.sort(links[last], axis=1).T
    forest = minimum_spanning_tree(csr_array((last + 1, tuple(ends)), shape=(number, number)))
    return np.sort(forest.data.astype(np.int64)) - 1
