"""The boundary of a surface: the edges of exactly one face, and the closed loops that they form."""

import numpy as np

from core.arrays import Ints
from core.mesh.edges import HalfEdges, component_labels


def boundary_edges(sides: HalfEdges) -> Ints:
    """Edges of exactly one face, shape (b, 2), the vertex of lower number first."""
    alone: Ints = sides.edges[sides.face_counts == 1]
    return alone


def boundary_half_edges(faces: Ints, sides: HalfEdges) -> Ints:
    """The same edges, in the same order, each in the direction of its face, shape (b, 2).

    Parameters
    ----------
    faces : int64, shape (f, 3)
    sides : HalfEdges
        Half-edges of these faces.
    """
    alone = sides.order[sides.first[sides.face_counts == 1]]
    return np.stack([faces.ravel()[alone], faces[:, [1, 2, 0]].ravel()[alone]], axis=1)


def boundary_loops(edges: Ints, vertices: int) -> Ints:
    """The loop of each boundary half-edge, shape (b,); -1 for edges that form no simple closed loop.

    At each vertex of a loop, one half-edge begins and one ends. Loops are numbered from 0 in the order of
    their lowest vertices.

    Parameters
    ----------
    edges : int64, shape (b, 2)
        As `boundary_half_edges` gives them.
    vertices : int
        The number of vertices of the mesh.
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
