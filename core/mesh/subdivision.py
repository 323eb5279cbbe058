"""Subdivision of long edges: samples and geodesics become independent of the resolution of the mesh."""

import numpy as np

from core.arrays import Floats, Ints
from core.mesh.cleaning import face_areas
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE

PASSES = 24
"""Largest number of passes. Each pass halves long edges; 24 suffice for edges a million times the target."""


def edge_table(faces: Ints) -> tuple[Ints, Ints]:
    """Distinct edges, shape (e, 2), and the indices of each face's edges 01, 12 and 20, shape (f, 3)."""
    sides = half_edges(faces)
    of_side = np.empty(len(sides.order), dtype=np.int64)
    of_side[sides.order] = np.repeat(np.arange(len(sides.first)), sides.face_counts)
    return sides.edges, of_side.reshape(-1, 3)


def split_faces(faces: Ints, middle: Ints, vertices: Floats) -> Ints:
    """Faces after the subdivision of edges, conforming.

    A face with two midpoints is cut along the shorter diagonal, or at the earlier vertex if both are equal.

    Parameters
    ----------
    faces : int64, shape (f, 3)
    middle : int64, shape (f, 3)
        Vertex at the midpoint of each face's edges 01, 12 and 20; -1 where the edge is not split.
    vertices : float64, shape (n, 3)
        The midpoints included.
    """
    marked = middle >= 0
    number = marked.sum(axis=1)
    pieces = [faces[number == 0]]
    one = number == 1
    if one.any():
        turn = np.argmax(marked[one], axis=1)
        corner = np.take_along_axis(faces[one], (turn[:, None] + np.arange(3)) % 3, axis=1)
        m = middle[one][np.arange(len(turn)), turn]
        pieces += [
            np.stack([corner[:, 0], m, corner[:, 2]], axis=1),
            np.stack([m, corner[:, 1], corner[:, 2]], axis=1),
        ]
    two = number == 2
    if two.any():
        turn = (np.argmin(marked[two], axis=1) + 1) % 3
        steps = (turn[:, None] + np.arange(3)) % 3
        corner = np.take_along_axis(faces[two], steps, axis=1)
        split = np.take_along_axis(middle[two], steps, axis=1)
        a, b, c = corner.T
        ab, bc = split[:, 0], split[:, 1]
        pieces.append(np.stack([ab, b, bc], axis=1))
        across = np.linalg.norm(vertices[a] - vertices[bc], axis=1)
        other = np.linalg.norm(vertices[ab] - vertices[c], axis=1)
        equal = np.abs(across - other) <= TIE * other
        short = np.where(equal, a < c, across < other)[:, None]
        pieces.append(np.where(short, np.stack([a, ab, bc], axis=1), np.stack([a, ab, c], axis=1)))
        pieces.append(np.where(short, np.stack([a, bc, c], axis=1), np.stack([ab, bc, c], axis=1)))
    three = number == 3
    if three.any():
        a, b, c = faces[three].T
        ab, bc, ca = middle[three].T
        pieces += [
            np.stack([a, ab, ca], axis=1),
            np.stack([ab, b, bc], axis=1),
            np.stack([ca, bc, c], axis=1),
            np.stack([ab, bc, ca], axis=1),
        ]
    return np.concatenate(pieces)


def split_long_edges(mesh: Mesh, longest: float, most: int) -> Mesh:
    """Split edges longer than `longest` at their midpoints; the surface and the first n vertices stay.

    The faces of a split edge are cut into two, three or four. Passes repeat until no long edge is left or the
    next pass would make more than `most` vertices.

    Parameters
    ----------
    mesh : Mesh
        With n vertices.
    longest : float
        Largest length of an edge, > 0.
    most : int
        Largest number of vertices.
    """
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(PASSES):
        edges, of_face = edge_table(faces)
        length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        long = np.flatnonzero(length > longest)
        if len(long) == 0 or len(vertices) + len(long) > most:
            break
        middle = np.full(len(edges), -1, dtype=np.int64)
        middle[long] = len(vertices) + np.arange(len(long))
        vertices = np.concatenate([vertices, vertices[edges[long]].mean(axis=1)])
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
