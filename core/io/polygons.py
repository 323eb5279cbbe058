"""Polygons cut into triangles, with every index checked."""

import numpy as np

from core.arrays import Ints
from core.errors import MalformedMeshError
from core.io.checks import Limits, within


def triangles(corners: Ints, sizes: Ints, vertices: int, limits: Limits) -> Ints:
    """Cut polygons into fans of triangles around their first corner.

    A fan covers a convex polygon, and any polygon that its first corner sees whole.

    Parameters
    ----------
    corners : int64, shape (sum(sizes),)
        The polygons' vertices, counted from 0, one polygon after another.
    sizes : int64, shape (n,)
        Corners of each polygon, >= 0. Those of fewer than three have no area and are left out.
    vertices : int
        Number of vertices there are.
    limits : Limits
        Only its number of faces matters.

    Returns
    -------
    faces : int64, shape (f, 3)

    Raises
    ------
    MalformedMeshError
        An index outside 0 .. vertices - 1.
    MeshTooComplexError
        More triangles than the limit.
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
