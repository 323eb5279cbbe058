"""Closest points on triangles: the projection onto the plane if it lies inside, else a point of an edge."""

import numpy as np

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled, constant

TINY = float(np.finfo(np.float64).tiny)
"""The least squared length and squared normal: a triangle may be a line or a point."""


def closest_on_triangles(corners: Floats, near: Ints, points: Floats) -> Floats:
    """The point closest to each of n points on some triangles, shape (n, 3).

    Parameters
    ----------
    corners : float64, shape (f, 3, 3)
        Corners of the triangles.
    near : int64, shape (n, k)
        For each point, the indices of the triangles that are searched; the first of several closest ones
        counts.
    points : float64, shape (n, 3)
        Finite.
    """
    return _closest(constant(corners), constant(near), constant(points))


@compiled
def _closest(corners: Floats, near: Ints, points: Floats) -> Floats:
    closest = np.empty((len(near), 3))
    found, work = np.empty(3), np.empty((7, 3))
    for i in range(len(near)):
        least = np.inf
        for face in near[i]:
            _closest_on_triangle(corners[face], points[i], found, work)
            square = _squared_distance(found, points[i])
            if square < least:
                least = square
                closest[i] = found
    return closest


@compiled
def _closest_on_triangle(corners: Floats, point: Floats, found: Floats, work: Floats) -> None:
    """Fill `found`, shape (3,), with the point of one triangle, shape (3, 3), closest to a point.

    `work`, shape (7, 3), is overwritten.
    """
    sides, away, normal = work[:3], work[3:6], work[6]
    for a in range(3):
        for x in range(3):
            sides[a, x] = corners[(a + 1) % 3, x] - corners[a, x]
            away[a, x] = point[x] - corners[a, x]
    for x in range(3):
        normal[x] = _cross(sides[0], sides[1], x)
    inside = True
    for a in range(3):
        turn = 0.0
        for x in range(3):
            turn += _cross(sides[a], away[a], x) * normal[x]
        inside = inside and turn > 0.0
    if inside:
        height = _dot(away[0], normal) / max(_dot(normal, normal), TINY)
        for x in range(3):
            found[x] = point[x] - height * normal[x]
        return
    least, on_side = np.inf, normal  # the normal is not needed any more
    for a in range(3):
        share = min(max(_dot(away[a], sides[a]) / max(_dot(sides[a], sides[a]), TINY), 0.0), 1.0)
        for x in range(3):
            on_side[x] = corners[a, x] + share * sides[a, x]
        square = _squared_distance(on_side, point)
        if square < least:
            least = square
            found[:] = on_side


@compiled
def _cross(one: Floats, other: Floats, axis: int) -> float:
    """One coordinate of a cross product."""
    y, z = (axis + 1) % 3, (axis + 2) % 3
    return float(one[y] * other[z] - one[z] * other[y])


@compiled
def _dot(one: Floats, other: Floats) -> float:
    return float(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


@compiled
def _squared_distance(one: Floats, other: Floats) -> float:
    return float((one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 + (one[2] - other[2]) ** 2)
