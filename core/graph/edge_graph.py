"""The edge graph of a mesh: edges, diagonals across pairs of faces, bridges between components."""

import numpy as np
from scipy.sparse import coo_array, csr_array

from core.arrays import Floats, Ints
from core.graph.bridges import component_bridges
from core.mesh.edges import HalfEdges, edge_lengths, edge_order, half_edges, starts_of
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE

MOST_FACES = 6
"""Edges with more faces than this get no diagonals."""


def diagonals(vertices: Floats, faces: Ints, sides: HalfEdges | None = None) -> tuple[Ints, Floats]:
    """Straight paths across pairs of adjacent faces.

    Two adjacent faces are unfolded into a plane. If the segment between their opposite corners crosses the
    shared edge, it is a path on the surface. With diagonals a shortest path follows twelve directions instead
    of six, and comes closer to the geodesic.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
    faces : int64, shape (f, 3)
    sides : HalfEdges, optional
        The half-edges of the faces, if they are known.

    Returns
    -------
    ends : int64, shape (d, 2)
        Vertices at both ends.
    lengths : float64, shape (d,)
    """
    sides = sides or half_edges(faces)
    opposite = faces[:, [2, 0, 1]].ravel()[sides.order]
    low, high = sides.low, sides.high
    edge_of = np.repeat(np.arange(len(sides.first)), sides.face_counts)
    few = (sides.face_counts <= MOST_FACES)[edge_of]
    pairs = [np.flatnonzero((edge_of[i:] == edge_of[:-i]) & few[i:]) for i in range(1, MOST_FACES)]
    start = np.concatenate(pairs)
    end = np.concatenate([first + i for i, first in enumerate(pairs, start=1)])
    a, b = vertices[low[start]], vertices[high[start]]
    p, q = opposite[start], opposite[end]
    axis = b - a
    edge = np.linalg.norm(axis, axis=1)
    axis = axis / np.where(edge > 0.0, edge, 1.0)[:, None]
    to_p, to_q = vertices[p] - a, vertices[q] - a
    along_p, along_q = np.einsum("ni,ni->n", to_p, axis), np.einsum("ni,ni->n", to_q, axis)
    up_p = np.sqrt(np.maximum(np.einsum("ni,ni->n", to_p, to_p) - along_p**2, 0.0))
    up_q = np.sqrt(np.maximum(np.einsum("ni,ni->n", to_q, to_q) - along_q**2, 0.0))
    height = up_p + up_q
    crossing = (along_p * up_q + along_q * up_p) / np.where(height > 0.0, height, 1.0)
    inside = (crossing > TIE * edge) & (crossing < (1.0 - TIE) * edge)
    valid = (height > 0.0) & inside & (p != q)
    lengths = np.hypot(along_p - along_q, height)
    return np.stack([p[valid], q[valid]], axis=1), lengths[valid]


def symmetric(edges: Ints, lengths: Floats, count: int) -> csr_array:
    """The symmetric csr matrix of a graph, shape (count, count); the shortest of parallel edges is kept.

    Parameters
    ----------
    edges : int64, shape (e, 2)
    lengths : float64, shape (e,)
    count : int
        Number of vertices.
    """
    low, high = np.minimum(*edges.T), np.maximum(*edges.T)
    order = edge_order(low, high)
    low, high = low[order], high[order]
    first = np.flatnonzero(starts_of(low, high))
    low, high, lengths = low[first], high[first], np.minimum.reduceat(lengths[order], first)
    # Higher ends first: the columns of each row ascend as they are, and need not be sorted.
    rows, columns = np.concatenate([high, low]), np.concatenate([low, high])
    return coo_array((np.concatenate([lengths, lengths]), (rows, columns)), shape=(count, count)).tocsr()


def edge_graph(mesh: Mesh, bridges: Ints | None = None, *, unfold: bool = True) -> csr_array:
    """The graph of the mesh's vertices: edges, bridges between components, and diagonals, with their lengths.

    Parameters
    ----------
    mesh : Mesh
    bridges : int64, shape (components - 1, 2), optional
        From `core.graph.bridges.component_bridges`, if known.
    unfold : bool
        Whether to add `diagonals`; the paper's graph has edges only.

    Returns
    -------
    csr_array, shape (n, n)
        Symmetric and connected, with positive lengths.
    """
    count = len(mesh.vertices)
    sides = half_edges(mesh.faces)
    edges = np.concatenate([sides.edges, component_bridges(mesh) if bridges is None else bridges])
    lengths = edge_lengths(mesh.vertices, edges)
    if unfold:
        ends, across = diagonals(mesh.vertices, mesh.faces, sides)
        edges, lengths = np.concatenate([edges, ends]), np.concatenate([lengths, across])
    shortest = 1e-12 * float(lengths.max())
    return symmetric(edges, np.maximum(lengths, shortest), count)
