"""A balanced k-d tree of points, as arrays that compiled loops can search."""

from typing import NamedTuple

import numpy as np

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled, constant

LEAF = 12
"""Largest number of points in a leaf."""


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
    """The tree of the points, shape (n, 3), finite."""
    return PointTree(*_build(constant(points)))


@compiled
def _build(points: Floats) -> tuple[int, Ints, Floats, Floats]:
    count = len(points)
    levels = 0
    while count > LEAF << levels:
        levels += 1
    order, placed = np.arange(count), points.copy()
    boxes = np.empty((2 << levels, 6))
    for level in range(levels + 1):
        for i in range(1 << level):
            start, end = i * count >> level, (i + 1) * count >> level
            box = boxes[(1 << level) + i]
            for axis in range(3):
                low = high = placed[start, axis]
                for place in range(start + 1, end):
                    low, high = min(low, placed[place, axis]), max(high, placed[place, axis])
                box[axis], box[3 + axis] = low, high
            if level < levels:
                widest = int(np.argmax(box[3:] - box[:3]))
                _halve(order, placed, widest, start, (2 * i + 1) * count >> (level + 1), end - 1)
    return levels, order, placed, boxes


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
