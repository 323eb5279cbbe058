"""Closest points of triangles: of a few given ones, or of a whole surface by a tree of bounding boxes."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled, constant

LEAF = 4
"""Triangles of a leaf."""

CELLS = 1 << 20
"""Cells along each axis of the grid in which centroids are sorted."""

DEPTH = 64
"""Most boxes that wait: a binary tree of 2^62 leaves."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """A complete binary tree whose leaves are triangles in the order of a space-filling curve.

    Attributes
    ----------
    corners : float64, shape (f, 3, 3)
        Corners of the triangles.
    order : int64, shape (f,)
        Triangles, sorted by the Morton code of their centroid.
    boxes : float64, shape (n, 2, 3)
        Least and largest coordinates; node i has the children 2 i + 1 and 2 i + 2, and the last (n + 1) / 2
        nodes are leaves.
    """

    corners: Floats
    order: Ints
    boxes: Floats

    def closest(self, points: Floats, guess: Ints | None = None) -> tuple[Floats, Ints]:
        """Return the closest point of the surface to each point, by its triangle.

        Parameters
        ----------
        points : float64, shape (n, 3)
            Finite.
        guess : int64, shape (n,), or None
            Triangles near the points, which shorten the search.

        Returns
        -------
        shares : float64, shape (n, 3)
            Barycentric coordinates of the closest point.
        faces : int64, shape (n,)
            The triangle that holds it.
        """
        near = np.full(len(points), self.order[0]) if guess is None else guess
        found = _closest(
            constant(self.corners),
            constant(self.order),
            constant(self.boxes),
            constant(points),
            constant(near),
        )
        return found[0], found[1]


def triangle_tree(corners: Floats) -> TriangleTree:
    """Return the tree of one or more triangles, shape (f, 3, 3)."""
    centroids = corners.mean(axis=1)
    low = centroids.min(axis=0)
    span = max(float((centroids.max(axis=0) - low).max()), float(np.finfo(np.float64).tiny))
    cells = np.minimum((centroids - low) / span * CELLS, CELLS - 1).astype(np.int64)
    order = np.argsort(_interleaved(cells), kind="stable")
    leaves = 1 << max(0, int(np.ceil(np.log2(len(order) / LEAF))))
    padded = np.minimum(np.arange(leaves * LEAF), len(order) - 1)
    sorted_corners = corners[order[padded]].reshape(leaves, -1, 3)
    level = np.stack([sorted_corners.min(axis=1), sorted_corners.max(axis=1)], axis=1)
    levels = [level]
    while len(level) > 1:
        level = np.stack(
            [
                np.minimum(level[::2, 0], level[1::2, 0]),
                np.maximum(level[::2, 1], level[1::2, 1]),
            ],
            axis=1,
        )
        levels.append(level)
    return TriangleTree(corners, order, np.concatenate(levels[::-1]))


def closest_on_triangles(corners: Floats, near: Ints, points: Floats) -> Floats:
    """Return the point closest to each of n points on some triangles, shape (n, 3).

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
    return _closest_of(constant(corners), constant(near), constant(points))


def _interleaved(cells: Ints) -> Ints:
    """Return the Morton codes, shape (n,), of cells of 20 bits each, shape (n, 3)."""
    code = np.zeros(len(cells), dtype=np.int64)
    for axis in range(3):
        bits = cells[:, axis]
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | (bits << shift)) & mask
        code |= bits << axis
    return code


@compiled
def _squared_gap(boxes: Floats, node: int, px: float, py: float, pz: float) -> float:
    """Return the squared distance of a point from the box of a node."""
    x = max(boxes[node, 0, 0] - px, px - boxes[node, 1, 0], 0.0)
    y = max(boxes[node, 0, 1] - py, py - boxes[node, 1, 1], 0.0)
    z = max(boxes[node, 0, 2] - pz, pz - boxes[node, 1, 2], 0.0)
    return float(x * x + y * y + z * z)


@compiled
def _nearest(  # noqa: PLR0911 - one return for each region of the plane
    corners: Floats, face: int, px: float, py: float, pz: float
) -> tuple[float, float]:
    """Return the shares of the second and of the third corner in the closest point of a triangle.

    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
    """
    ax, ay, az = corners[face, 0, 0], corners[face, 0, 1], corners[face, 0, 2]
    bx, by, bz = corners[face, 1, 0] - ax, corners[face, 1, 1] - ay, corners[face, 1, 2] - az
    cx, cy, cz = corners[face, 2, 0] - ax, corners[face, 2, 1] - ay, corners[face, 2, 2] - az
    dx, dy, dz = px - ax, py - ay, pz - az
    d1, d2 = bx * dx + by * dy + bz * dz, cx * dx + cy * dy + cz * dz
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    bb, cc, bc = bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz, bx * cx + by * cy + bz * cz
    d3, d4 = d1 - bb, d2 - bc
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    third = d1 * d4 - d3 * d2
    if third <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / (d1 - d3), 0.0
    d5, d6 = d1 - bc, d2 - cc
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    second = d5 * d2 - d1 * d6
    if second <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6)
    first = d3 * d6 - d5 * d4
    if first <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        share = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - share, share
    total = first + second + third
    return second / total, third / total


@compiled
def _point(corners: Floats, face: int, u: float, v: float) -> tuple[float, float, float]:
    """Return the point of a triangle with shares u and v of the second and of the third corner."""
    w = 1.0 - u - v
    x = w * corners[face, 0, 0] + u * corners[face, 1, 0] + v * corners[face, 2, 0]
    y = w * corners[face, 0, 1] + u * corners[face, 1, 1] + v * corners[face, 2, 1]
    z = w * corners[face, 0, 2] + u * corners[face, 1, 2] + v * corners[face, 2, 2]
    return x, y, z


@compiled
def _closest_of(corners: Floats, near: Ints, points: Floats) -> Floats:
    closest = np.empty((len(near), 3))
    for i in range(len(near)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        least = np.inf
        for face in near[i]:
            u, v = _nearest(corners, face, px, py, pz)
            x, y, z = _point(corners, face, u, v)
            square = (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2
            if square < least:
                least = square
                closest[i, 0], closest[i, 1], closest[i, 2] = x, y, z
    return closest


@compiled
def _closest(corners: Floats, order: Ints, boxes: Floats, points: Floats, guess: Ints) -> tuple[Floats, Ints]:
    shares = np.empty((len(points), 3))
    faces = np.zeros(len(points), dtype=np.int64)
    waiting, gaps = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    inner = len(boxes) // 2
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        least = np.inf
        # The guess comes first, as a leaf of its own.
        waiting[0], gaps[0] = 0, 0.0
        waiting[1], gaps[1] = -1, 0.0
        count = 2
        while count > 0:
            count -= 1
            node = waiting[count]
            if gaps[count] >= least:
                continue
            # A leaf: its triangles.
            if node < 0 or node >= inner:
                start = 0 if node < 0 else (node - inner) * LEAF
                stop = start + 1 if node < 0 else min(start + LEAF, len(order))
                for position in range(start, stop):
                    face = guess[i] if node < 0 else order[position]
                    u, v = _nearest(corners, face, px, py, pz)
                    x, y, z = _point(corners, face, u, v)
                    square = (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2
                    if square < least:
                        least = square
                        faces[i] = face
                        shares[i, 0], shares[i, 1], shares[i, 2] = 1.0 - u - v, u, v
                continue
            # A branch: of its two boxes the nearer one is searched first.
            child, sibling = 2 * node + 1, 2 * node + 2
            near, far = _squared_gap(boxes, child, px, py, pz), _squared_gap(boxes, sibling, px, py, pz)
            if far < near:
                child, sibling, near, far = sibling, child, far, near
            if far < least:
                waiting[count], gaps[count] = sibling, far
                count += 1
            if near < least:
                waiting[count], gaps[count] = child, near
                count += 1
    return shares, faces
