"""Simplification: fewer faces by quadric error, after edge contraction if large, or by vertex clustering."""

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.errors import ParameterError
from core.mesh.cleaning import clean, distinct_faces, face_areas
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled, compiled_for_reading

MOST_WORK = 1e8
"""The work of quadric collapses grows as the sum of the squared valences. Above this number (some seconds)
vertices are clustered instead."""

NEAR = 0.01
"""Clustering ends when the number of faces is nearer to the wanted one than this share of it."""

SHORT = 1.1
"""Vertices are clustered if quadric collapses leave more than this many times the wanted faces."""

CONNECTED = 1.5
"""Least number of faces per vertex of a connected surface: a closed one has 2, a soup of triangles 1/3.
Without common edges a collapse removes a triangle."""

FINENESS = 4
"""Connected meshes of more than this many vertices for each wanted one are contracted before quadric
collapses, whose time and memory grow with the mesh."""

SLOWEST = 0.9
"""Contraction ends before a round that leaves more than this share of the vertices."""

TANGENTIAL = 1e-3
"""Weight of the squared distance of a contracted vertex from the mean of the merged ones, beside that from
their faces' planes."""

_HALVINGS = 30


def decimate(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Simplify to a share of the faces by quadric error (Garland and Heckbert 1997).

    If the collapses would take too long (`MOST_WORK`) or stop too early (`SHORT`), `cluster_vertices` is used
    instead; the rule depends on the mesh only, not on a clock. The seed shuffles the faces, which decides
    between collapses of nearly equal cost. Raise ParameterError if the amount, a share of the faces, is
    outside (0, 1], and NoTrianglesError if no face is left of a mesh of very few faces.
    """
    check_amount(amount, np.finfo(float).tiny, 1.0)
    wanted = max(4, round(amount * len(mesh.faces)))
    if wanted >= len(mesh.faces):
        return mesh
    if _collapses_in_time(mesh.faces):
        order = np.random.default_rng(seed).permutation(len(mesh.faces))
        points, faces = fast_simplification.simplify(
            mesh.vertices.copy(), mesh.faces[order].astype(np.int32), target_count=wanted
        )
        if 0 < len(faces) <= SHORT * wanted:
            return Mesh(points, faces)
    return cluster_vertices(mesh, wanted, seed)


def _collapses_in_time(faces: Ints) -> bool:
    """Return whether the work of quadric collapses is at most `MOST_WORK`."""
    valences = np.bincount(faces.ravel()).astype(np.float64)
    return float(valences @ valences) <= MOST_WORK


def cluster_vertices(mesh: Mesh, faces: int, seed: int) -> Mesh:
    """Merge the vertices in each cell of a cubic grid at their mean (Rossignac and Borrel 1993).

    Bisection finds the cell size that comes near to the wanted number of distinct faces; the seed shifts the
    grid. Raise NoTrianglesError if no cell size leaves a face.
    """
    shift = np.random.default_rng(seed).random(3)
    low = mesh.vertices.min(axis=0)
    most, least = diagonal(mesh), 1e-5 * diagonal(mesh)
    best = _clustered(mesh, low, least, shift)
    for _ in range(_HALVINGS):
        size = float(np.sqrt(least * most))
        clustered = _clustered(mesh, low, size, shift)
        if len(clustered[1]) > 0 and abs(len(clustered[1]) - faces) < abs(len(best[1]) - faces):
            best = clustered
        if abs(len(best[1]) - faces) <= NEAR * faces:
            break
        least, most = (size, most) if len(clustered[1]) > faces else (least, size)
    return Mesh(*best)


def _clustered(mesh: Mesh, low: Floats, size: float, shift: Floats) -> tuple[Floats, Ints]:
    """Return vertices, shape (n, 3), and distinct faces, shape (f, 3), clustered with one cell size."""
    cells = np.floor((mesh.vertices - low) / size + shift).astype(np.int64)
    width = int(cells.max()) + 1
    _, cell = np.unique((cells[:, 0] * width + cells[:, 1]) * width + cells[:, 2], return_inverse=True)
    count = np.bincount(cell)
    points = np.stack([np.bincount(cell, weights=axis) / count for axis in mesh.vertices.T], axis=1)
    faces = cell[mesh.faces]
    return points, faces[distinct_faces(faces)]


def check_amount(amount: float, least: float, most: float) -> None:
    """Raise a ParameterError unless least <= amount <= most."""
    if not least <= amount <= most:
        raise ParameterError(f"an amount of {amount} lies outside {least} to {most}")


def diagonal(mesh: Mesh) -> float:
    """Return the length of the diagonal of the axis-aligned bounding box."""
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def simplify(mesh: Mesh, vertices: int) -> Mesh:
    """Simplify to about `vertices` vertices by quadric error (Garland and Heckbert 1997), and clean.

    Coordinates are rounded to six decimals first: every collapse on a planar part costs 0, and the last bits,
    which change with the pose, would decide between them. Large connected meshes are contracted before
    (`contract_edges`). If the collapses would take too long (`MOST_WORK`), as around a vertex of very many
    faces, `cluster_vertices` is used instead. The mesh is in its normal frame, and has more vertices than are
    wanted.
    """
    points, faces = np.round(mesh.vertices, 6), mesh.faces
    most = FINENESS * vertices
    if len(points) > most and len(faces) >= CONNECTED * len(points):
        points, faces = contract_edges(points, faces, most)
        # Contracted vertices of a flat part are exactly coplanar: the quadric is then singular, its minimum
        # may be far away, and faces flip. Rounding to a hundredth of an even mesh's sides prevents it.
        step = 0.01 * np.sqrt(float(face_areas(points, faces).sum()) / most)
        points = np.round(points / step) * step
    share = vertices / len(points)
    if not _collapses_in_time(faces):
        return clean(cluster_vertices(Mesh(points, faces), round(share * len(faces)), 0)).mesh
    points, faces = fast_simplification.simplify(points, faces.astype(np.int32), target_reduction=1.0 - share)
    return clean(Mesh(points, faces)).mesh


def contract_edges(points: Floats, faces: Ints, most: int) -> tuple[Floats, Ints]:
    """Merge pairs of neighbouring vertices, round by round, until at most `most` are left.

    A round contracts a matching of the edges (Karypis and Kumar 1998), the shortest sides of the faces, in
    the order of the faces. A vertex goes to the point of least quadric error of the vertices that it
    replaces (Garland and Heckbert 1997), so that ridges and corners stay sharp. Vertices on a boundary and on
    nonmanifold edges stay until the other vertices do not suffice. Sides stay that are longer than those of
    an even mesh with `most / 2` vertices, so that coarse parts keep their shape.

    The faces, shape (f, 3), have three different corners each. The results are points, shape (m, 3), at least
    `most / 2`, and more than `most` if the sides are too long, and faces, shape (g, 3).
    """
    if len(points) <= most:
        return points, faces
    weights, quadrics = np.ones(len(points)), _quadrics(points, faces)
    longest = 4.0 / np.sqrt(3.0) * float(face_areas(points, faces).sum()) / most
    held = True
    while len(points) > most:
        contracted = _contracted(points, weights, quadrics, faces, longest, held)
        if len(contracted[0]) <= SLOWEST * len(points) and len(contracted[3]) > 0:
            points, weights, quadrics, faces = contracted
        elif held:
            held = False
        else:
            break
    return points, faces


@compiled_for_reading
def _quadrics(points: Floats, faces: Ints) -> Floats:
    """Return the quadric of each vertex, shape (n, 9): its faces' planes, weighted by twice their areas.

    The squared distance of v from the planes is v A v - 2 b v, but for a constant; the numbers are A's upper
    triangle by rows, then b.
    """
    quadrics = np.zeros((len(points), 9))
    normal, plane = np.empty(3), np.empty(9)
    for f in range(len(faces)):
        p, q, r = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] = (q[i] - p[i]) * (r[j] - p[j]) - (q[j] - p[j]) * (r[i] - p[i])
        size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        if size == 0.0:
            continue
        height = (normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2]) / size
        entry = 0
        for i in range(3):
            for j in range(i, 3):
                plane[entry] = normal[i] * normal[j] / size
                entry += 1
        for axis in range(3):
            plane[6 + axis] = height * normal[axis]
        for corner in range(3):
            for i in range(9):
                quadrics[faces[f, corner], i] += plane[i]
    return quadrics


@compiled
def _inside(count: int, faces: Ints) -> NDArray[np.bool_]:
    """Return whether each vertex is inside the surface: on no boundary and on no nonmanifold edge.

    The edges opposite to an inner vertex form a closed path, on which each neighbour is the end of two.
    """
    ends = np.zeros(count, dtype=np.int64)
    for f in range(len(faces)):
        a, b, c = faces[f]
        ends[a] ^= b ^ c
        ends[b] ^= c ^ a
        ends[c] ^= a ^ b
    inside: NDArray[np.bool_] = ends == 0
    return inside


@compiled_for_reading
def _contracted(
    points: Floats, weights: Floats, quadrics: Floats, faces: Ints, longest: float, held: bool
) -> tuple[Floats, Floats, Floats, Ints]:
    """Return vertices, weights, quadrics and faces after one round.

    `weights` are numbers of merged vertices, shape (n,); `longest` is the square of the longest side that is
    contracted; `held` tells whether vertices on a boundary stay.
    """
    partner, free = np.full(len(points), -1), _inside(len(points), faces) | (not held)
    # A matching: each face offers its shortest side, if neither end is taken.
    for f in range(len(faces)):
        shortest, start, end = longest, -1, -1
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            length = 0.0
            for axis in range(3):
                length += (points[a, axis] - points[b, axis]) ** 2
            if length <= shortest and free[a] and free[b]:
                shortest, start, end = length, a, b
        if start >= 0 and partner[start] < 0 and partner[end] < 0:
            partner[start], partner[end] = end, start
    # Two partners have one number.
    number, count = np.empty(len(points), dtype=np.int64), 0
    for v in range(len(points)):
        if partner[v] < 0 or partner[v] > v:
            number[v] = count
            count += 1
        else:
            number[v] = number[partner[v]]
    # Weights, positions and quadrics add up.
    merged, merged_weights, merged_quadrics = np.zeros((count, 3)), np.zeros(count), np.zeros((count, 9))
    for v in range(len(points)):
        merged_weights[number[v]] += weights[v]
        for axis in range(3):
            merged[number[v], axis] += weights[v] * points[v, axis]
        for i in range(9):
            merged_quadrics[number[v], i] += quadrics[v, i]
    # The mean of two partners moves to the least quadric error.
    for v in range(len(points)):
        if partner[v] > v:
            square = 0.0
            for axis in range(3):
                merged[number[v], axis] /= merged_weights[number[v]]
                square += (points[v, axis] - points[partner[v], axis]) ** 2
            _move(merged[number[v]], merged_quadrics[number[v]], square)
        elif partner[v] < 0:
            merged[number[v]] = points[v]
    # Faces that keep three corners.
    kept, left = np.empty_like(faces), 0
    for f in range(len(faces)):
        for i in range(3):
            kept[left, i] = number[faces[f, i]]
        if kept[left, 0] != kept[left, 1] != kept[left, 2] != kept[left, 0]:
            left += 1
    return merged, merged_weights, merged_quadrics, kept[:left]


@compiled
def _move(point: Floats, quadric: Floats, farthest: float) -> None:
    """Move a point to the least quadric error, unless that is farther away than the root of `farthest`.

    `TANGENTIAL` adds a share of the squared distance from where the point is: nothing else holds it on a flat
    part.
    """
    tangential = TANGENTIAL * (quadric[0] + quadric[3] + quadric[5])
    a, b, c = quadric[0] + tangential, quadric[1], quadric[2]
    d, e, f = quadric[3] + tangential, quadric[4], quadric[5] + tangential
    x, y, z = point
    right_x = quadric[6] - (quadric[0] * x + b * y + c * z)
    right_y = quadric[7] - (b * x + quadric[3] * y + e * z)
    right_z = quadric[8] - (c * x + e * y + quadric[5] * z)
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * first + b * second + c * third
    if not determinant > 0.0:
        return
    step_x = (first * right_x + second * right_y + third * right_z) / determinant
    step_y = (second * right_x + (a * f - c * c) * right_y + (b * c - a * e) * right_z) / determinant
    step_z = (third * right_x + (b * c - a * e) * right_y + (a * d - b * b) * right_z) / determinant
    if step_x * step_x + step_y * step_y + step_z * step_z <= farthest:
        point[0] += step_x
        point[1] += step_y
        point[2] += step_z
