"""Gaps between the components of a set of points: the nearest point of another component, by a k-d tree."""

import numpy as np

from core.arrays import Floats, Ints
from core.graph.point_tree import PointTree
from core.numerics.compilation import compiled

DEPTH = 64
"""Entries of a search's stack: one for each level of the tree, and one more."""


@compiled
def _square_to_point(points: Floats, place: int, x: float, y: float, z: float) -> float:
    dx, dy, dz = x - points[place, 0], y - points[place, 1], z - points[place, 2]
    return float(dx * dx + dy * dy + dz * dz)


@compiled
def _square_to_box(boxes: Floats, node: int, x: float, y: float, z: float) -> float:
    """Squared distance to a node's box. Rounding is monotonic: no point of it comes out nearer."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return float(dx * dx + dy * dy + dz * dz)


@compiled
def update_gaps(tree: PointTree, labels: Ints, nearest: Ints, gaps: Floats) -> None:
    """Distance from each point to the nearest one of another component, when components have grown.

    Parameters
    ----------
    tree : PointTree
    labels : int64, shape (n,)
        Component of each point, two components or more.
    nearest : int64, shape (n,)
        By place, the place of the nearest point of another component, or -1; written. Searched again if that
        point is now in the same component.
    gaps : float64, shape (n,)
        The distances, by point.
    """
    levels, order, points, boxes = tree
    count, leaves = len(points), 1 << levels
    mine = labels[order]
    # The component of all points of a node, or -1.
    component_of = np.empty(2 * leaves, dtype=np.int64)
    for node in range(2 * leaves - 1, 0, -1):
        if node >= leaves:
            inside = mine[(node - leaves) * count >> levels : (node - leaves + 1) * count >> levels]
            component_of[node] = inside[0] if (inside == inside[0]).all() else -1
        else:
            child, sibling = component_of[2 * node], component_of[2 * node + 1]
            component_of[node] = child if child == sibling else -1
    waiting, squares = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    # The search starts with what was found for the place before, which is close by.
    found = 0
    for place in range(count):
        label = mine[place]
        if nearest[place] >= 0 and mine[nearest[place]] != label:
            found = nearest[place]
            continue
        x, y, z = points[place]
        best = _square_to_point(points, found, x, y, z) if mine[found] != label else np.inf
        waiting[0], squares[0], top = 1, 0.0, 1
        while top > 0:
            top -= 1
            node, square = waiting[top], squares[top]
            while node < leaves and square < best:
                near, far = 2 * node, 2 * node + 1
                square, far_square = np.inf, np.inf
                if component_of[near] != label:
                    square = _square_to_box(boxes, near, x, y, z)
                if component_of[far] != label:
                    far_square = _square_to_box(boxes, far, x, y, z)
                if square > far_square:
                    near, far, square, far_square = far, near, far_square, square
                if far_square < best:
                    waiting[top], squares[top] = far, far_square
                    top += 1
                node = near
            if square < best:
                for other in range((node - leaves) * count >> levels, (node - leaves + 1) * count >> levels):
                    square = _square_to_point(points, other, x, y, z)
                    if square < best and mine[other] != label:
                        best, found = square, other
        nearest[place] = found
        gaps[order[place]] = np.sqrt(best)


@compiled
def earliest_outside(tree: PointTree, labels: Ints, points: Floats, own: Ints, radii: Floats) -> Ints:
    """The first point of another component within each radius, shape (m,).

    Parameters
    ----------
    tree : PointTree
    labels : int64, shape (n,)
        Component of each point.
    points : float64, shape (m, 3)
        Centres of the balls.
    own : int64, shape (m,)
        Component of each centre.
    radii : float64, shape (m,)
        A point of another component is within each.
    """
    levels, order, placed, boxes = tree
    count, leaves = len(placed), 1 << levels
    earliest = np.full(len(points), count)
    waiting = np.empty(DEPTH, dtype=np.int64)
    for i in range(len(points)):
        x, y, z = points[i]
        limit = radii[i] * radii[i]
        waiting[0], top = 1, 1
        while top > 0:
            top -= 1
            node = waiting[top]
            if _square_to_box(boxes, node, x, y, z) > limit:
                continue
            if node < leaves:
                waiting[top], waiting[top + 1] = 2 * node, 2 * node + 1
                top += 2
                continue
            for place in range((node - leaves) * count >> levels, (node - leaves + 1) * count >> levels):
                other = order[place]
                if (
                    other < earliest[i]
                    and labels[other] != own[i]
                    and _square_to_point(placed, place, x, y, z) <= limit
                ):
                    earliest[i] = other
    return earliest
