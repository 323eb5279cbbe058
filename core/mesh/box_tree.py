"""A tree of bounding boxes: closest points of triangles, and nearest points of another component."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled, compiled_for_reading

LEAF = 4
"""Triangles or points of a leaf."""

CELLS = 1 << 20
"""Cells along each axis of the grid in which centroids are sorted."""

DEPTH = 64
"""Most boxes that wait: a binary tree of 2^62 leaves."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """The tree of a surface's triangles, by their corners, shape (f, 3, 3).

    `order` is that of the centroids' Morton codes, and `boxes` are those of `box_tree`.
    """

    corners: Floats
    order: Ints
    boxes: Floats

    def closest(
        self, points: Floats, guess: Ints | None = None, near: Floats | None = None
    ) -> tuple[Floats, Ints]:
        """Return the closest point of the surface to each of n points, shape (n, 3), finite.

        The results are its barycentric coordinates, float64 of shape (n, 3), and the triangle that holds it,
        int64 of shape (n,). `guess`, shape (n,), has triangles near the points, which shorten the search. A
        search ends with any point of the surface within `near`, shape (n,), the distances of interest.
        """
        enough = np.zeros(len(points)) if near is None else near**2
        if guess is not None:
            return _closest(self.corners, self.order, self.boxes, points, guess, enough)
        # Along a space-filling curve, the triangle of the point before is near.
        order, unknown = _morton_order(points), np.full(len(points), -1)
        shares, faces = np.empty((len(points), 3)), np.empty(len(points), dtype=np.int64)
        shares[order], faces[order] = _closest(
            self.corners, self.order, self.boxes, points[order], unknown, enough[order]
        )
        return shares, faces


def triangle_tree(corners: Floats) -> TriangleTree:
    """Return the tree of one or more triangles, shape (f, 3, 3)."""
    order = _morton_order(corners.mean(axis=1))
    return TriangleTree(corners, order, box_tree(corners, order))


def box_tree(corners: Floats, order: Ints) -> Floats:
    """Return the boxes of a complete binary tree whose leaves are `LEAF` items each, in a given order.

    `corners`, shape (n, c, 3), has the c corners of each item, n >= 1; items that are near should be near in
    the `order`, shape (n,). The boxes, shape (m, 2, 3), are least and largest coordinates; node i has the
    children 2 i + 1 and 2 i + 2, and the last (m + 1) / 2 nodes are leaves.
    """
    leaves = 1 << max(0, int(np.ceil(np.log2(len(order) / LEAF))))
    padded = np.minimum(np.arange(leaves * LEAF), len(order) - 1)
    sorted_corners = corners[order[padded]].reshape(leaves, -1, 3)
    levels = [np.stack([sorted_corners.min(axis=1), sorted_corners.max(axis=1)], axis=1)]
    while len(levels[-1]) > 1:
        below, above = levels[-1][::2], levels[-1][1::2]
        merged = [np.minimum(below[:, 0], above[:, 0]), np.maximum(below[:, 1], above[:, 1])]
        levels.append(np.stack(merged, axis=1))
    return np.concatenate(levels[::-1])


@compiled_for_reading
def closest_on_triangles(corners: Floats, near: Ints, points: Floats) -> Floats:
    """Return the point closest to each of n points on some triangles, shape (n, 3).

    `corners`, shape (f, 3, 3), are those of the triangles; `near`, shape (n, k), has the triangles that are
    searched for each point, of which the first closest one counts; `points`, shape (n, 3), are finite.
    """
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


def _morton_order(points: Floats) -> Ints:
    """Return the order of points, shape (n, 3), along a space-filling curve, by Morton codes, shape (n,)."""
    if not len(points):
        return np.empty(0, dtype=np.int64)
    low = points.min(axis=0)
    span = max(float((points.max(axis=0) - low).max()), float(np.finfo(np.float64).tiny))
    cells = np.minimum((points - low) / span * CELLS, CELLS - 1).astype(np.int64)
    code = np.zeros(len(cells), dtype=np.int64)
    for axis in range(3):
        # Two zeros after each of the 20 bits of a cell.
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
    return np.argsort(code, kind="stable")


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


@compiled_for_reading
def _closest(
    corners: Floats, order: Ints, boxes: Floats, points: Floats, guess: Ints, enough: Floats
) -> tuple[Floats, Ints]:
    """Return what `TriangleTree.closest` does. A guess of -1 is the triangle of the point before.

    `enough`, shape (n,), has the squared distances at which searches end.
    """
    shares = np.empty((len(points), 3))
    faces = np.zeros(len(points), dtype=np.int64)
    waiting, gaps = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    inner = len(boxes) // 2
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        least = np.inf
        start = guess[i] if guess[i] >= 0 else faces[max(i - 1, 0)]
        # The start comes first, as a leaf of its own.
        waiting[0], gaps[0] = 0, 0.0
        waiting[1], gaps[1] = -1, 0.0
        count = 2
        while count > 0 and least > enough[i]:
            count -= 1
            node = waiting[count]
            if gaps[count] >= least:
                continue
            # A leaf: its triangles.
            if node < 0 or node >= inner:
                begin = 0 if node < 0 else (node - inner) * LEAF
                stop = begin + 1 if node < 0 else min(begin + LEAF, len(order))
                for position in range(begin, stop):
                    face = start if node < 0 else order[position]
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


@compiled
def update_gaps(
    vertices: Floats, order: Ints, boxes: Floats, labels: Ints, nearest: Ints, gaps: Floats
) -> None:
    """Update the nearest vertex of another component, or -1, and the gap to it, of each of n vertices.

    `order` and `boxes` are those of `box_tree`; `labels`, shape (n,), have the component of each vertex, two
    or more in all. `nearest` and `gaps`, shapes (n,), are written where the nearest vertex is now in the same
    component, or not known.
    """
    count, inner = len(order), len(boxes) // 2
    # The component of all vertices of a node, or -1.
    component_of = np.empty(len(boxes), dtype=np.int64)
    for node in range(len(boxes) - 1, -1, -1):
        if node < inner:
            child, sibling = component_of[2 * node + 1], component_of[2 * node + 2]
            component_of[node] = child if child == sibling else -1
            continue
        start = min((node - inner) * LEAF, count - 1)
        component_of[node] = labels[order[start]]
        for position in range(start, min(start + LEAF, count)):
            if labels[order[position]] != component_of[node]:
                component_of[node] = -1
    waiting, squares = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    # The search starts with what was found for the vertex before, which is close by.
    closest = 0
    for vertex in order:
        label = labels[vertex]
        if nearest[vertex] >= 0 and labels[nearest[vertex]] != label:
            closest = nearest[vertex]
            continue
        x, y, z = vertices[vertex, 0], vertices[vertex, 1], vertices[vertex, 2]
        least = _squared_distance(vertices, closest, x, y, z) if labels[closest] != label else np.inf
        waiting[0], squares[0], top = 0, 0.0, 1
        while top > 0:
            top -= 1
            node, square = waiting[top], squares[top]
            # Down to a leaf, into the nearer of two boxes; the other one waits.
            while node < inner and square < least:
                near, far = 2 * node + 1, 2 * node + 2
                square, far_square = np.inf, np.inf
                if component_of[near] != label:
                    square = _squared_gap(boxes, near, x, y, z)
                if component_of[far] != label:
                    far_square = _squared_gap(boxes, far, x, y, z)
                if square > far_square:
                    near, far, square, far_square = far, near, far_square, square
                if far_square < least:
                    waiting[top], squares[top] = far, far_square
                    top += 1
                node = near
            if square >= least:
                continue
            # The leaf: its vertices of other components.
            start = (node - inner) * LEAF
            for position in range(start, min(start + LEAF, count)):
                square = _squared_distance(vertices, order[position], x, y, z)
                if square < least and labels[order[position]] != label:
                    least, closest = square, order[position]
        nearest[vertex] = closest
        gaps[vertex] = np.sqrt(least)


@compiled_for_reading
def earliest_outside(
    vertices: Floats, order: Ints, boxes: Floats, labels: Ints, centres: Ints, radii: Floats
) -> Ints:
    """Return the first vertex of another component within a radius of each centre, a vertex, shape (m,).

    A vertex of another component is within each of the `radii`, shape (m,); the others as for `update_gaps`.
    """
    count, inner = len(order), len(boxes) // 2
    earliest = np.full(len(centres), count)
    waiting = np.empty(DEPTH, dtype=np.int64)
    for i in range(len(centres)):
        x, y, z = vertices[centres[i], 0], vertices[centres[i], 1], vertices[centres[i], 2]
        limit = radii[i] * radii[i]
        waiting[0], top = 0, 1
        while top > 0:
            top -= 1
            node = waiting[top]
            if _squared_gap(boxes, node, x, y, z) > limit:
                continue
            if node < inner:
                waiting[top], waiting[top + 1] = 2 * node + 1, 2 * node + 2
                top += 2
                continue
            start = (node - inner) * LEAF
            for vertex in order[start : min(start + LEAF, count)]:
                if (
                    vertex < earliest[i]
                    and labels[vertex] != labels[centres[i]]
                    and _squared_distance(vertices, vertex, x, y, z) <= limit
                ):
                    earliest[i] = vertex
    return earliest


@compiled
def _squared_distance(points: Floats, point: int, x: float, y: float, z: float) -> float:
    dx, dy, dz = x - points[point, 0], y - points[point, 1], z - points[point, 2]
    return float(dx * dx + dy * dy + dz * dz)
