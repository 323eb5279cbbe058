"""Edge contraction: neighbouring vertices of a large mesh are merged, round by round."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.mesh.cleaning import face_areas
from core.numerics.compilation import compiled, constant

SLOWEST = 0.9
"""Contraction ends before a round that leaves more than this share of the vertices."""

TANGENTIAL = 1e-3
"""Weight of the squared distance of a contracted vertex from the mean of the merged ones, beside that from
their faces' planes."""


def contract_edges(points: Floats, faces: Ints, most: int) -> tuple[Floats, Ints]:
    """Merge pairs of neighbouring vertices, round by round, until at most `most` are left.

    A round contracts a matching of the edges (Karypis and Kumar 1998), the shortest sides of the faces, in
    the order of the faces. A vertex goes to the point of least quadric error of the vertices that it
    replaces (Garland and Heckbert 1997), so that ridges and corners stay sharp. Vertices on a boundary and on
    nonmanifold edges stay until the other vertices do not suffice. Sides stay that are longer than those of
    an even mesh with `most / 2` vertices, so that coarse parts keep their shape.

    Parameters
    ----------
    points : float64, shape (n, 3)
    faces : int64, shape (f, 3)
        With three different corners each.
    most : int

    Returns
    -------
    points : float64, shape (m, 3)
        At least `most / 2`; more than `most` if the sides are too long.
    faces : int64, shape (g, 3)
    """
    if len(points) <= most:
        return points, faces
    weights, quadrics = np.ones(len(points)), _quadrics(constant(points), constant(faces))
    longest = 4.0 / np.sqrt(3.0) * float(face_areas(points, faces).sum()) / most
    held = True
    while len(points) > most:
        found = _contracted(constant(points), weights, quadrics, constant(faces), longest, held)
        if len(found[0]) <= SLOWEST * len(points) and len(found[3]) > 0:
            points, weights, quadrics, faces = found
        elif held:
            held = False
        else:
            break
    return points, faces


@compiled
def _quadrics(points: Floats, faces: Ints) -> Floats:
    """The quadric of each vertex, shape (n, 9): of the planes of its faces, weighted by twice their areas.

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
        place = 0
        for i in range(3):
            for j in range(i, 3):
                plane[place] = normal[i] * normal[j] / size
                place += 1
        for axis in range(3):
            plane[6 + axis] = height * normal[axis]
        for corner in range(3):
            for i in range(9):
                quadrics[faces[f, corner], i] += plane[i]
    return quadrics


@compiled
def _inside(count: int, faces: Ints) -> NDArray[np.bool_]:
    """Whether each of `count` vertices is inside the surface, and not on a boundary or a nonmanifold edge.

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


@compiled
def _contracted(
    points: Floats, weights: Floats, quadrics: Floats, faces: Ints, longest: float, held: bool
) -> tuple[Floats, Floats, Floats, Ints]:
    """Vertices, weights, quadrics and faces after one round.

    `weights` are numbers of merged vertices, shape (n,); `longest` is the square of the longest side that is
    contracted; `held` tells whether vertices on a boundary stay.
    """
    other, free = np.full(len(points), -1), _inside(len(points), faces) | (not held)
    for f in range(len(faces)):
        shortest, start, end = longest, -1, -1
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            length = 0.0
            for axis in range(3):
                length += (points[a, axis] - points[b, axis]) ** 2
            if length <= shortest and free[a] and free[b]:
                shortest, start, end = length, a, b
        if start >= 0 and other[start] < 0 and other[end] < 0:
            other[start], other[end] = end, start
    place, count = np.empty(len(points), dtype=np.int64), 0
    for v in range(len(points)):
        if other[v] < 0 or other[v] > v:
            place[v] = count
            count += 1
        else:
            place[v] = place[other[v]]
    merged, numbers, sums = np.zeros((count, 3)), np.zeros(count), np.zeros((count, 9))
    for v in range(len(points)):
        numbers[place[v]] += weights[v]
        for axis in range(3):
            merged[place[v], axis] += weights[v] * points[v, axis]
        for i in range(9):
            sums[place[v], i] += quadrics[v, i]
    for v in range(len(points)):
        if other[v] > v:
            square = 0.0
            for axis in range(3):
                merged[place[v], axis] /= numbers[place[v]]
                square += (points[v, axis] - points[other[v], axis]) ** 2
            _move(merged[place[v]], sums[place[v]], square)
        elif other[v] < 0:
            merged[place[v]] = points[v]
    kept, left = np.empty_like(faces), 0
    for f in range(len(faces)):
        for i in range(3):
            kept[left, i] = place[faces[f, i]]
        if kept[left, 0] != kept[left, 1] != kept[left, 2] != kept[left, 0]:
            left += 1
    return merged, numbers, sums, kept[:left]


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
