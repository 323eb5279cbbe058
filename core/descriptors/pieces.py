"""The pieces of a surface, its connected components, in a few lengths each: a print plate has several parts.

Equal pieces are one kind, whatever their positions, so that a plate of 40 equal parts takes one row.
"""

import numpy as np

from core.arrays import Float32s, Floats, Ints
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled_for_reading

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
    count = int(labels.max()) + 1
    areas = face_areas(surface.vertices, surface.faces)
    totals, volumes, moments = _integrals(surface.vertices, surface.faces, areas, labels, count)
    sides = surface.half_edges
    volumes[labels[sides.edges[sides.face_counts == 1, 0]]] = 0.0
    radii = np.sqrt(np.maximum(np.linalg.eigvalsh(moments), 0.0))
    return np.column_stack([np.sqrt(totals), np.cbrt(np.abs(volumes)), radii])


@compiled_for_reading
def _integrals(
    vertices: Floats, faces: Ints, areas: Floats, labels: Ints, count: int
) -> tuple[Floats, Floats, Floats]:
    """Return areas and signed volumes of pieces, shape (c,), and mean second moments about their centroids.

    The moments, shape (c, 3, 3), are there in the lower triangles.
    """
    totals, volumes = np.zeros(count), np.zeros(count)
    centres, moments = np.zeros((count, 3)), np.zeros((count, 3, 3))
    for f in range(len(faces)):
        piece = labels[faces[f, 0]]
        totals[piece] += areas[f]
        for axis in range(3):
            for i in range(3):
                centres[piece, axis] += areas[f] * vertices[faces[f, i], axis] / 3.0
    for piece in range(count):
        centres[piece] /= totals[piece]
    for f in range(len(faces)):
        piece = labels[faces[f, 0]]
        a = vertices[faces[f, 0]] - centres[piece]
        b = vertices[faces[f, 1]] - centres[piece]
        c = vertices[faces[f, 2]] - centres[piece]
        volumes[piece] += a[0] * (b[1] * c[2] - b[2] * c[1]) / 6.0
        volumes[piece] += a[1] * (b[2] * c[0] - b[0] * c[2]) / 6.0
        volumes[piece] += a[2] * (b[0] * c[1] - b[1] * c[0]) / 6.0
        # The integral of x x^T over a triangle is A / 12 times the sum over the corners and their sum.
        for i in range(3):
            for j in range(i + 1):
                product = a[i] * a[j] + b[i] * b[j] + c[i] * c[j]
                product += (a[i] + b[i] + c[i]) * (a[j] + b[j] + c[j])
                moments[piece, i, j] += areas[f] * product / (12.0 * totals[piece])
    return totals, volumes, moments


def number_of_pieces(rows: Float32s) -> int:
    """Return the number of pieces of all kinds."""
    return int(rows[:, COUNT].sum())
