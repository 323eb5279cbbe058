"""The edge graph of a mesh: edges, diagonals across pairs of faces, bridges between components."""

import numpy as np
from scipy.sparse import coo_array, csr_array

from core.arrays import Floats, Ints
from core.graph.bridges import component_bridges
from core.mesh.edges import HalfEdges, edge_lengths, half_edges, starts_of
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE
from core.numerics.compilation import compiled_for_reading
from core.numerics.radix_sort import lexical_order

MOST_FACES = 6
"""Edges with more faces than this get no diagonals."""


def diagonals(vertices: Floats, faces: Ints, sides: HalfEdges | None = None) -> tuple[Ints, Floats]:
    """Return straight paths across pairs of adjacent faces.

    Two adjacent faces are unfolded into a plane. If the segment between their opposite corners crosses the
    shared edge, it is a path on the surface. With diagonals a shortest path follows twelve directions instead
    of six, and comes closer to the geodesic. `sides` are the half-edges of the faces, if they are known. The
    results are the vertices at both ends, int64 of shape (d, 2), and the lengths, float64 of shape (d,).
    """
    sides = sides or half_edges(faces)
    opposite = faces[:, [2, 0, 1]].ravel()[sides.order]
    return _diagonals(vertices, opposite, sides.edges, sides.first, sides.face_counts, TIE)


@compiled_for_reading
def _diagonals(
    vertices: Floats, opposite: Ints, edges: Ints, first: Ints, face_counts: Ints, tie: float
) -> tuple[Ints, Floats]:
    """Return the ends and lengths of the diagonals across each edge.

    `opposite`, shape (3 f,), has the opposite corners of the faces at each edge, edge after edge. `tie` is
    `core.mesh.ordering.TIE`, an argument since the compiler's cache does not notice changes of other files.
    """
    few = np.minimum(face_counts, MOST_FACES + 1)
    most = (few * (few - 1) // 2).sum()
    ends, lengths, total = np.empty((most, 2), dtype=np.int64), np.empty(most), 0
    axis, along, up = np.empty(3), np.empty(MOST_FACES), np.empty(MOST_FACES)
    for e in range(len(edges)):
        count, start = face_counts[e], first[e]
        if count < 2 or count > MOST_FACES:
            continue
        a, b = edges[e, 0], edges[e, 1]
        square = 0.0
        for i in range(3):
            axis[i] = vertices[b, i] - vertices[a, i]
            square += axis[i] * axis[i]
        edge = np.sqrt(square)
        if edge > 0.0:
            axis /= edge
        for k in range(count):
            along[k], square = 0.0, 0.0
            for i in range(3):
                gap = vertices[opposite[start + k], i] - vertices[a, i]
                along[k] += gap * axis[i]
                square += gap * gap
            up[k] = np.sqrt(max(square - along[k] * along[k], 0.0))
        for k in range(count):
            for j in range(k):
                height = up[k] + up[j]
                if opposite[start + k] == opposite[start + j] or not height > 0.0:
                    continue
                crossing = (along[k] * up[j] + along[j] * up[k]) / height
                if tie * edge < crossing < (1.0 - tie) * edge:
                    ends[total, 0], ends[total, 1] = opposite[start + j], opposite[start + k]
                    lengths[total] = np.hypot(along[k] - along[j], height)
                    total += 1
    return ends[:total], lengths[:total]


def symmetric(edges: Ints, lengths: Floats, count: int) -> csr_array:
    """Return the symmetric csr matrix of edges, shape (e, 2), with the shortest of parallel ones."""
    low, high = np.minimum(*edges.T), np.maximum(*edges.T)
    order = lexical_order(low, high)
    low, high = low[order], high[order]
    first = np.flatnonzero(starts_of(low, high))
    low, high, lengths = low[first], high[first], np.minimum.reduceat(lengths[order], first)
    # Higher ends first: the columns of each row ascend as they are, and need not be sorted.
    rows, columns = np.concatenate([high, low]), np.concatenate([low, high])
    return coo_array((np.concatenate([lengths, lengths]), (rows, columns)), shape=(count, count)).tocsr()


def edge_graph(mesh: Mesh, bridges: Ints | None = None, *, unfold: bool = True) -> csr_array:
    """Return the graph of the mesh's vertices: edges, bridges between components and, to `unfold`, diagonals.

    The paper's graph has edges only. `bridges`, shape (components - 1, 2), are those of
    `core.graph.bridges.component_bridges`, if known. The graph, shape (n, n), is symmetric and connected,
    with positive lengths.
    """
    count = len(mesh.vertices)
    sides = mesh.half_edges
    edges = np.concatenate([sides.edges, component_bridges(mesh) if bridges is None else bridges])
    lengths = edge_lengths(mesh.vertices, edges)
    if unfold:
        ends, across = diagonals(mesh.vertices, mesh.faces, sides)
        edges, lengths = np.concatenate([edges, ends]), np.concatenate([lengths, across])
    shortest = 1e-12 * float(lengths.max())
    return symmetric(edges, np.maximum(lengths, shortest), count)
