"""Edges, boundary loops and connected components of a triangulation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled_for_reading
from core.numerics.radix_sort import lexical_order


@dataclass(frozen=True, eq=False)
class HalfEdges:
    """Half-edges sorted by edge; half-edge 3 f + i runs from corner i of face f to the next corner.

    `order`, shape (3 f,), has the half-edges grouped by edge, those of one edge in the order of the faces;
    `low` <= `high`, shapes (3 f,), their end points, in ascending lexical order; `first`, shape (e,), the
    position in `order` of the first half-edge of each distinct edge.
    """

    order: Ints
    low: Ints
    high: Ints
    first: Ints

    @property
    def edges(self) -> Ints:
        """The distinct edges, shape (e, 2)."""
        return np.stack([self.low[self.first], self.high[self.first]], axis=1)

    @property
    def face_counts(self) -> Ints:
        """Number of faces at each edge, shape (e,)."""
        return np.diff(self.first, append=len(self.order))


def half_edges(faces: Ints) -> HalfEdges:
    """Return the half-edges of the faces, shape (f, 3), sorted by edge."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = lexical_order(low, high)
    low, high = low[order], high[order]
    return HalfEdges(order, low, high, first=np.flatnonzero(starts_of(low, high)))


@compiled_for_reading
def edge_lengths(vertices: Floats, edges: Ints) -> Floats:
    """Return the lengths of edges, shape (e,), between vertices, shape (n, 3)."""
    lengths = np.empty(len(edges))
    for edge in range(len(edges)):
        total = 0.0
        for axis in range(3):
            total += (vertices[edges[edge, 0], axis] - vertices[edges[edge, 1], axis]) ** 2
        lengths[edge] = np.sqrt(total)
    return lengths


def starts_of(*columns: Ints) -> NDArray[np.bool_]:
    """Return whether each of sorted rows, by columns, differs from the one before it; the first does."""
    new = np.zeros(len(columns[0]), dtype=bool)
    new[:1] = True
    for column in columns:
        new[1:] |= column[1:] != column[:-1]
    return new


@compiled_for_reading
def component_labels(count: int, cells: Ints) -> tuple[int, Ints]:
    """Return the number of connected components, and that of each of `count` vertices, shape (count,).

    The cells are faces or edges, shape (f, 3) or (e, 2). Components are numbered by their first vertices.
    """
    # Union-find: the root of a component is its first vertex.
    root = np.arange(count)
    for f in range(len(cells)):
        for side in range(cells.shape[1] - 1):
            a, b = cells[f, side], cells[f, side + 1]
            while root[a] != a:
                root[a] = root[root[a]]
                a = root[a]
            while root[b] != b:
                root[b] = root[root[b]]
                b = root[b]
            if a < b:
                root[b] = a
            else:
                root[a] = b
    number, labels = 0, np.empty(count, dtype=np.int64)
    for v in range(count):
        root[v] = root[root[v]]
        if root[v] == v:
            labels[v] = number
            number += 1
        else:
            labels[v] = labels[root[v]]
    return number, labels


def boundary_edges(sides: HalfEdges) -> Ints:
    """Return the edges of exactly one face, shape (b, 2), the vertex of lower number first."""
    alone: Ints = sides.edges[sides.face_counts == 1]
    return alone


def boundary_half_edges(faces: Ints, sides: HalfEdges) -> Ints:
    """Return the edges of `boundary_edges`, each in the direction of its face, shape (b, 2)."""
    alone = sides.order[sides.first[sides.face_counts == 1]]
    return np.stack([faces.ravel()[alone], faces[:, [1, 2, 0]].ravel()[alone]], axis=1)


def boundary_loops(edges: Ints, vertices: int) -> Ints:
    """Return the loop of each boundary half-edge, shape (b,); -1 for edges of no simple closed loop.

    At each vertex of a loop, one half-edge begins and one ends. Loops are numbered from 0 in the order of
    their lowest vertices. The edges are those of `boundary_half_edges`.
    """
    _, labels = component_labels(vertices, edges)
    starts, ends = (np.bincount(column, minlength=vertices) for column in edges.T)
    simple = np.ones(vertices, dtype=bool)
    simple[labels[(starts != ends) | (starts > 1)]] = False
    component = labels[edges[:, 0]]
    on = simple[component]
    loops = np.full(len(edges), -1, dtype=np.int64)
    loops[on] = np.unique(component[on], return_inverse=True)[1]
    return loops
