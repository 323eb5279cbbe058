"""Triangulation of polygons, with checked indices."""

import numpy as np

from core.arrays import Ints
from core.errors import MalformedMeshError
from core.io.checks import Limits, within


def triangles(corners: Ints, sizes: Ints, vertices: int, limits: Limits) -> Ints:
    """Cut polygons into fans of triangles around their first corners.

    A fan covers a convex polygon, and any polygon that is star-shaped about its first corner.

    Parameters
    ----------
    corners : int64, shape (sum(sizes),)
        The polygons' vertices, counted from 0, one polygon after another.
    sizes : int64, shape (n,)
        Number of corners of each polygon, >= 0. Polygons of fewer than three corners are left out.
    vertices : int
        Number of vertices of the mesh.
    limits : Limits
        Only its number of faces is used.

    Returns
    -------
    faces : int64, shape (f, 3)

    Raises
    ------
    MalformedMeshError
        An index is outside 0 .. vertices - 1.
    MeshTooComplexError
        There are more triangles than the limit.
    """
    if len(corners) and (corners.min() < 0 or corners.max() >= vertices):
        wrong = int(corners.min() if corners.min() < 0 else corners.max())
        raise MalformedMeshError(
            f"a face refers to vertex {wrong}, counted from 0, but there are {vertices} vertices"
        )
    if (sizes == 3).all():
        within(len(sizes), limits.faces, "triangles")
        return corners.reshape(-1, 3)
    pieces = np.maximum(sizes - 2, 0)
    within(int(pieces.sum()), limits.faces, "triangles")
    polygon = np.repeat(np.arange(len(sizes)), pieces)
    piece = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first = (np.cumsum(sizes) - sizes)[polygon]
    faces: Ints = corners[np.column_stack([first, first + piece + 1, first + piece + 2])]
    return faces
