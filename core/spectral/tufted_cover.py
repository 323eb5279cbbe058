"""The tufted cover: a closed, oriented surface from any triangles (Sharp and Crane 2020, section 4.1).

N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020. Every face has a front and a back
copy. Around each edge, the side of a face is glued to the side of the next face that it faces; at a boundary
edge the front is glued to the back of the same face.
"""

import numpy as np

from core.arrays import Floats, Ints
from core.mesh.edges import HalfEdges


def tufted_cover(vertices: Floats, faces: Ints, sides: HalfEdges) -> tuple[Ints, Ints]:
    """Return the faces of the cover, and the gluing of their half-edges.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
    faces : int64, shape (f, 3)
    sides : HalfEdges
        The half-edges of the faces.

    Returns
    -------
    cover : int64, shape (2 f, 3)
        The faces, then the same with their corners in the opposite order.
    twin : int64, shape (6 f,)
        The half-edge that each half-edge is glued to, in the opposite direction.
    """
    count = len(faces)
    cover = np.concatenate([faces, faces[:, ::-1][:, [2, 0, 1]]])
    order = _around_edges(vertices, faces, sides)
    reverse = 3 * count + order // 3 * 3 + 2 - order % 3
    ascends = faces.ravel()[order] == sides.low
    # The copy that faces larger angles around the edge runs from its lower to its higher vertex.
    upper, lower = np.where(ascends, order, reverse), np.where(ascends, reverse, order)
    following = np.arange(1, len(order) + 1)
    following[sides.first + sides.face_counts - 1] = sides.first
    twin = np.empty(6 * count, dtype=np.int64)
    twin[upper], twin[lower[following]] = lower[following], upper
    return cover, twin


def _around_edges(vertices: Floats, faces: Ints, sides: HalfEdges) -> Ints:
    """Return the half-edges grouped by edge; those of one edge by the angle of their faces around it."""
    order = sides.order.copy()
    edge_of = np.repeat(np.arange(len(sides.first)), sides.face_counts)
    crowded = np.flatnonzero((sides.face_counts > 2)[edge_of])
    if not len(crowded):
        return order
    edge, low = edge_of[crowded], vertices[sides.low[crowded]]
    axis = vertices[sides.high[crowded]] - low
    length = np.linalg.norm(axis, axis=1)
    axis /= np.where(length > 0.0, length, 1.0)[:, None]
    across = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = np.cross(axis, across)
    outwards = vertices[faces[:, [2, 0, 1]].ravel()[order[crowded]]] - low
    angles = np.arctan2(
        np.einsum("ij,ij->i", outwards, np.cross(axis, first)), np.einsum("ij,ij->i", outwards, first)
    )
    order[crowded] = order[crowded[np.lexsort((angles, edge))]]
    return order
