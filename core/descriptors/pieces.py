"""The pieces of a surface, its connected components, in a few lengths each: a print plate has several parts.

Equal pieces are one kind, whatever their positions, so that a plate of 40 equal parts takes one row.
"""

import numpy as np

from core.arrays import Float32s, Floats, Ints
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh

MOST, LOOKED_AT = 64, 1024
"""Largest number of kinds that are described, and of pieces that are looked at, those of greatest area."""

ALIKE = 1e-4
"""Largest relative difference of the lengths of two pieces of one kind; files in single precision round."""

SIZE, VOLUME, RADII, COUNT, WIDTH = 0, 1, slice(2, 5), 5, 6
"""Columns of a row of pieces, and their number."""


def pieces(surface: Mesh, labels: Ints) -> Float32s:
    """Return the kinds of the pieces of a cleaned mesh, the largest first, shape (k, `WIDTH`), k <= `MOST`.

    Columns: the square root of the area; the cube root of the enclosed volume, 0 for a piece that is open;
    the square roots of the three principal second moments of its surface about its centroid, ascending; all
    in the file's units, and invariant to motions and reflections. The last column is the number of pieces.

    Parameters
    ----------
    surface : Mesh
        Its area is > 0.
    labels : int64, shape (n,)
        The component of each vertex, from 0.
    """
    rows = piece_lengths(surface, labels)
    rows = rows[np.argsort(-rows[:, SIZE], kind="stable")[:LOOKED_AT]]
    kinds: list[Floats] = []
    while len(rows) and len(kinds) < MOST:
        equal = (np.abs(rows - rows[0]) <= ALIKE * rows[0, SIZE]).all(axis=1)
        kinds.append(np.append(rows[0], equal.sum()))
        rows = rows[~equal]
    return np.array(kinds, dtype=np.float32)


def piece_lengths(surface: Mesh, labels: Ints) -> Floats:
    """Return the lengths of each piece, in the order of the labels, shape (c, `COUNT`): see `pieces`."""
    faces = surface.faces
    of_face = labels[faces[:, 0]]
    count = int(of_face.max()) + 1
    areas = face_areas(surface.vertices, faces)
    corners = surface.vertices[faces]
    totals = np.maximum(_sums(of_face, areas, count), np.finfo(np.float64).tiny)
    centres = np.stack(
        [_sums(of_face, areas * middle, count) / totals for middle in corners.mean(axis=1).T], axis=1
    )
    corners = corners - centres[of_face][:, None]
    # The integral of x x^T over a triangle is A / 12 times the sum over the corners and their sum.
    points = np.concatenate([corners, corners.sum(axis=1, keepdims=True)], axis=1)
    moments = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(3):
            products = (points[:, :, i] * points[:, :, j]).sum(axis=1)
            moments[:, i, j] = _sums(of_face, areas * products, count) / (12.0 * totals)
    volumes = np.abs(_sums(of_face, np.linalg.det(corners), count)) / 6.0
    sides = surface.half_edges
    on_boundary = sides.edges[sides.face_counts == 1, 0]
    volumes[labels[on_boundary]] = 0.0
    radii = np.sqrt(np.maximum(np.linalg.eigvalsh(moments), 0.0))
    return np.column_stack([np.sqrt(totals), np.cbrt(volumes), radii])


def _sums(groups: Ints, values: Floats, count: int) -> Floats:
    return np.bincount(groups, weights=values, minlength=count).astype(np.float64)


def number_of_pieces(rows: Float32s) -> int:
    """Return the number of pieces of all kinds."""
    return int(rows[:, COUNT].sum())
