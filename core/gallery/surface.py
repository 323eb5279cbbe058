"""From parts to a triangle mesh: isosurface, relaxation to even triangles, decimation."""

from collections.abc import Sequence

import fast_simplification
import numpy as np
from scipy.sparse import coo_array

from core.arrays import Floats, Ints
from core.gallery.grid import Grid, cell_size
from core.gallery.parts import Part
from core.mesh.face_normals import face_normals

_SURPLUS = 2.0
"""Vertices of the isosurface over the wanted number; decimation removes the surplus."""

_LEAST_COSINE = 0.3
"""Least cosine between a face's normals before and after a relaxation step; it prevents folds."""


def surface(parts: Sequence[Part], vertices: int) -> tuple[Floats, Ints]:
    """Triangle surface of the blended parts.

    Parameters
    ----------
    parts : sequence of Part
        Joined in this order.
    vertices : int
        Wanted number; the result has about as many.

    Returns
    -------
    vertices : float64, shape (n, 3)
    faces : int64, shape (f, 3)
        Counter-clockwise seen from outside. Rarely, the decimation leaves an edge with more than two faces.
    """
    cell = cell_size(parts)
    grid = Grid.of(parts, cell)
    points, faces = grid.isosurface()
    if len(points) < _SURPLUS * vertices:
        # The number of vertices goes with the inverse square of the cell; aim five per cent above the least.
        grid = Grid.of(parts, cell * float(np.sqrt(len(points) / (1.05 * _SURPLUS * vertices))))
        points, faces = grid.isosurface()
    points = _relaxed(grid, points, faces, rounds=5)
    points, faces = fast_simplification.simplify(points, faces, target_count=2 * vertices)
    points, faces = points.astype(np.float64), faces.astype(np.int64)
    return _relaxed(grid, points, faces, rounds=2), faces


def _relaxed(grid: Grid, points: Floats, faces: Ints, rounds: int) -> Floats:
    """Move vertices to the mean of their neighbours and project them to the surface; this removes slivers."""
    tails, heads = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    graph = coo_array((np.ones(len(tails)), (tails, heads)), shape=(len(points),) * 2).tocsr()
    degree = graph.sum(axis=1)[:, None]
    for _ in range(rounds):
        moved = grid.projected(points + 0.5 * (graph @ points / degree - points))
        before = face_normals(points[faces])
        for _ in range(2):
            folded = np.einsum("ij,ij->i", before, face_normals(moved[faces])) < _LEAST_COSINE
            corners = np.unique(faces[folded])
            moved[corners] = points[corners]
        points = moved
    return points
