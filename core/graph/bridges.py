"""Bridges: the shortest gaps that join all components of a mesh, by Boruvka's algorithm and a k-d tree."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from core.mesh.ordering import TIE, tied_ranks
from core.numerics.compilation import compiled, constant

LEAF = 12
"""Largest number of points in a leaf."""

DEPTH = 64
"""Entries of a search's stack: one for each level of the tree, and one more."""


def component_bridges(mesh: Mesh) -> Ints:
    """Return the `bridges` between the connected components of a mesh, shape (components - 1, 2)."""
    return bridges(mesh.vertices, component_labels(len(mesh.vertices), mesh.faces)[1])


def bridges(vertices: Floats, labels: Ints) -> Ints:
    """Return vertex pairs that join all components by the shortest gaps, shape (components - 1, 2).

    The algorithm of Boruvka: in each round every component is joined to the nearest vertex outside it. The
    earliest vertices break ties; gaps within rounding of zero are equal.

    Parameters
    ----------
    vertices : float64, shape (n, 3)
        At two places or more.
    labels : int64, shape (n,)
        Connected component of each vertex, 0 .. components - 1.
    """
    count, number = len(vertices), int(labels.max()) + 1
    chosen = [np.empty((0, 2), dtype=np.int64)]
    if number == 1:
        return chosen[0]
    tree = point_tree(vertices)
    smallest = TIE * (tree.boxes[1, 3:] - tree.boxes[1, :3]).max()
    nearest, distances = np.full(count, -1), np.empty(count)
    while number > 1:
        labels = constant(labels)
        update_gaps(tree, labels, nearest, distances)
        gaps = np.maximum(distances, smallest)
        rank = tied_ranks(np.log(gaps))
        # The first vertex of the lowest rank in each component.
        first = np.full(number, count * count)
        np.minimum.at(first, labels, rank * count + np.arange(count))
        lead = first % count
        lead = lead[np.argsort(rank[lead], kind="stable")]
        outside = earliest_outside(tree, labels, vertices[lead], labels[lead], gaps[lead] * (1.0 + TIE))
        pairs = np.stack([lead, outside], axis=1)
        ends = labels[pairs]
        kept = _spanning_forest(ends)
        chosen.append(pairs[kept])
        number, group = component_labels(number, ends[kept])
        labels = group[labels]
    return np.concatenate(chosen)


@compiled
def _spanning_forest(links: Ints) -> NDArray[np.bool_]:
    """Return which links make a spanning forest (Kruskal 1956), shape (c,).

    Two components may each link to the other, by other vertices where gaps are equal: the later link stays.

    Parameters
    ----------
    links : int64, shape (c, 2)
        One from each component to another, the preferred first.
    """
    link_from, root = np.empty(len(links), dtype=np.int64), np.arange(len(links))
    kept = np.zeros(len(links), dtype=np.bool_)
    for i in range(len(links)):
        link_from[links[i, 0]] = i
    for i in range(len(links)):
        a, b = links[i]
        back = link_from[b]
        if back > i and links[back, 1] == a:
            continue
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        while root[b] != b:
            root[b] = root[root[b]]
            b = root[b]
        root[b] = a
        kept[i] = a != b
    return kept


class PointTree(NamedTuple):
    """A balanced k-d tree. Node 1 is the root, the children of node i are 2 i and 2 i + 1.

    Attributes
    ----------
    levels : int
        Number of levels below the root. Node 2 ** l + i of level l holds places i n >> l .. (i + 1) n >> l.
    order : int64, shape (n,)
        The point at each place.
    points : float64, shape (n, 3)
        Coordinates by place.
    boxes : float64, shape (2 ** (levels + 1), 6)
        Bounding box of each node: the lower corner, then the upper one. Row 0 is unused.
    """

    levels: int
    order: Ints
    points: Floats
    boxes: Floats


def point_tree(points: Floats) -> PointTree:
    """Return the tree of the points, shape (n, 3), finite."""
    return PointTree(*_build(constant(points)))


@compiled
def _build(points: Floats) -> tuple[int, Ints, Floats, Floats]:
    count = len(points)
    levels = 0
    while count > LEAF << levels:
        levels += 1
    order, positions = np.arange(count), points.copy()
    boxes = np.empty((2 << levels, 6))
    for level in range(levels + 1):
        for i in range(1 << level):
            start, end = i * count >> level, (i + 1) * count >> level
            box = boxes[(1 << level) + i]
            for axis in range(3):
                low = high = positions[start, axis]
                for position in range(start + 1, end):
                    low, high = min(low, positions[position, axis]), max(high, positions[position, axis])
                box[axis], box[3 + axis] = low, high
            if level < levels:
                widest = int(np.argmax(box[3:] - box[:3]))
                _halve(order, positions, widest, start, (2 * i + 1) * count >> (level + 1), end - 1)
    return levels, order, positions, boxes


@compiled
def _halve(order: Ints, points: Floats, axis: int, low: int, middle: int, high: int) -> None:
    """Rearrange places low .. high so that none before the middle exceeds one after it (Hoare 1961).

    Pivots are drawn by a linear congruential generator (Knuth's MMIX): no order of the file takes quadratic
    time in practice.
    """
    state = np.uint64(low)
    while low < high:
        state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
        pivot = points[low + np.int64((state >> np.uint64(33)) % np.uint64(high - low + 1)), axis]
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                for k in range(3):
                    points[i, k], points[j, k] = points[j, k], points[i, k]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@compiled
def _square_to_point(points: Floats, position: int, x: float, y: float, z: float) -> float:
    dx, dy, dz = x - points[position, 0], y - points[position, 1], z - points[position, 2]
    return float(dx * dx + dy * dy + dz * dz)


@compiled
def _square_to_box(boxes: Floats, node: int, x: float, y: float, z: float) -> float:
    """Return the squared distance to a node's box, rounded to no more than that to any point in it."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return float(dx * dx + dy * dy + dz * dz)


@compiled
def update_gaps(tree: PointTree, labels: Ints, nearest: Ints, gaps: Floats) -> None:
    """Update the distance from each point to the nearest one of another component.

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
    component = labels[order]
    # The component of all points of a node, or -1.
    component_of = np.empty(2 * leaves, dtype=np.int64)
    for node in range(2 * leaves - 1, 0, -1):
        if node >= leaves:
            inside = component[(node - leaves) * count >> levels : (node - leaves + 1) * count >> levels]
            component_of[node] = inside[0] if (inside == inside[0]).all() else -1
        else:
            child, sibling = component_of[2 * node], component_of[2 * node + 1]
            component_of[node] = child if child == sibling else -1
    waiting, squares = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    # The search starts with what was found for the place before, which is close by.
    closest = 0
    for position in range(count):
        label = component[position]
        if nearest[position] >= 0 and component[nearest[position]] != label:
            closest = nearest[position]
            continue
        x, y, z = points[position]
        best = _square_to_point(points, closest, x, y, z) if component[closest] != label else np.inf
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
                for candidate in range(
                    (node - leaves) * count >> levels, (node - leaves + 1) * count >> levels
                ):
                    square = _square_to_point(points, candidate, x, y, z)
                    if square < best and component[candidate] != label:
                        best, closest = square, candidate
        nearest[position] = closest
        gaps[order[position]] = np.sqrt(best)


@compiled
def earliest_outside(
    tree: PointTree, labels: Ints, points: Floats, centre_labels: Ints, radii: Floats
) -> Ints:
    """Return the first point of another component within each radius, shape (m,).

    Parameters
    ----------
    tree : PointTree
    labels : int64, shape (n,)
        Component of each point.
    points : float64, shape (m, 3)
        Centres of the balls.
    centre_labels : int64, shape (m,)
        Component of each centre.
    radii : float64, shape (m,)
        A point of another component is within each.
    """
    levels, order, sorted_points, boxes = tree
    count, leaves = len(sorted_points), 1 << levels
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
            for position in range((node - leaves) * count >> levels, (node - leaves + 1) * count >> levels):
                candidate = order[position]
                if (
                    candidate < earliest[i]
                    and labels[candidate] != centre_labels[i]
                    and _square_to_point(sorted_points, position, x, y, z) <= limit
                ):
                    earliest[i] = candidate
    return earliest
