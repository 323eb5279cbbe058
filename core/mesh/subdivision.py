"""Subdivision of long edges: samples and geodesics become independent of the resolution of the mesh."""

import numpy as np

from core.arrays import Floats, Ints
from core.mesh.cleaning import face_areas
from core.mesh.edges import edge_lengths, half_edges
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE
from core.numerics.compilation import compiled, compiled_for_reading

PASSES = 24
"""Largest number of passes. Each pass halves long edges; 24 suffice for edges a million times the target."""


def edge_table(faces: Ints) -> tuple[Ints, Ints]:
    """Return the distinct edges, shape (e, 2), and each face's edges 01, 12 and 20, shape (f, 3)."""
    sides = half_edges(faces)
    of_side = np.empty(len(sides.order), dtype=np.int64)
    of_side[sides.order] = np.repeat(np.arange(len(sides.first)), sides.face_counts)
    return sides.edges, of_side.reshape(-1, 3)


@compiled
def _distance(vertices: Floats, start: int, end: int) -> float:
    total = 0.0
    for axis in range(3):
        total += (vertices[start, axis] - vertices[end, axis]) ** 2
    return float(np.sqrt(total))


@compiled_for_reading
def split_faces(faces: Ints, middle: Ints, vertices: Floats) -> Ints:
    """Return the faces after the subdivision of edges: the uncut ones, then those with 1, 2 and 3 midpoints.

    A face with two midpoints is cut along the shorter diagonal, or at the earlier vertex if both are equal up
    to the share `TIE`. `middle`, shape (f, 3), has the vertex at the midpoint of each face's edges 01, 12 and
    20, and -1 where the edge is not split.
    """
    counts = np.zeros(4, dtype=np.int64)
    for f in range(len(faces)):
        counts[int(middle[f, 0] >= 0) + int(middle[f, 1] >= 0) + int(middle[f, 2] >= 0)] += 1
    total = counts[0] + 2 * counts[1] + 3 * counts[2] + 4 * counts[3]
    pieces = np.empty((total, 3), dtype=np.int64)
    offsets = np.zeros(4, dtype=np.int64)
    offsets[1] = counts[0]
    offsets[2] = offsets[1] + 2 * counts[1]
    offsets[3] = offsets[2] + 3 * counts[2]
    # The first corner is the one that makes the cases of a face alike.
    for f in range(len(faces)):
        number = int(middle[f, 0] >= 0) + int(middle[f, 1] >= 0) + int(middle[f, 2] >= 0)
        first = 0
        if number == 1:
            while middle[f, first] < 0:
                first += 1
        elif number == 2:
            while middle[f, first - 1] >= 0:
                first += 1
        second, third = (first + 1) % 3, (first + 2) % 3
        a, b, c = faces[f, first], faces[f, second], faces[f, third]
        ab, bc, ca = middle[f, first], middle[f, second], middle[f, third]
        row, step = offsets[number], counts[number]
        offsets[number] += 1
        if number == 0:
            pieces[row] = a, b, c
        elif number == 1:
            pieces[row] = a, ab, c
            pieces[row + step] = ab, b, c
        elif number == 2:
            across, diagonal = _distance(vertices, a, bc), _distance(vertices, ab, c)
            short = a < c if abs(across - diagonal) <= TIE * diagonal else across < diagonal
            pieces[row] = ab, b, bc
            pieces[row + step] = a, ab, bc if short else c
            pieces[row + 2 * step] = a if short else ab, bc, c
        else:
            pieces[row] = a, ab, ca
            pieces[row + step] = ab, b, bc
            pieces[row + 2 * step] = ca, bc, c
            pieces[row + 3 * step] = ab, bc, ca
    return pieces


def split_long_edges(mesh: Mesh, longest: float, most: int) -> Mesh:
    """Split edges longer than `longest` at their midpoints; the surface and the first n vertices stay.

    The faces of a split edge are cut into two, three or four. Passes repeat until no long edge is left, or no
    more fit into `most` vertices.
    """
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(PASSES):
        edges, of_face = edge_table(faces)
        length = edge_lengths(vertices, edges)
        room = max(most - len(vertices), 0)
        if room < len(length):
            # Of too many edges the longest are split, and of equally long ones all or none.
            longest = max(longest, np.partition(length, -room - 1)[-room - 1] * (1.0 + TIE))
        long = np.flatnonzero(length > longest)
        if len(long) == 0:
            break
        middle = np.full(len(edges), -1, dtype=np.int64)
        middle[long] = len(vertices) + np.arange(len(long))
        start, end = edges[long].T
        # A zero of either sign becomes +0.
        vertices = np.concatenate([vertices, 0.5 * (vertices[start] + vertices[end]) + 0.0])
        faces = split_faces(faces, middle[of_face], vertices)
    return mesh if faces is mesh.faces else Mesh(vertices, faces)


def refine(mesh: Mesh, vertices: int) -> Mesh:
    """Split long edges so that the mesh is as fine as an even one of about `vertices` vertices.

    An even triangulation of area A with n vertices has 2 n faces of side sqrt(2 A / (sqrt(3) n)). Edges up to
    1.5 times that side are not split.
    """
    area = float(face_areas(mesh.vertices, mesh.faces).sum())
    side = float(np.sqrt(2.0 * area / (np.sqrt(3.0) * vertices)))
    return split_long_edges(mesh, 1.5 * side, max(8 * vertices, 2 * len(mesh.vertices)))
