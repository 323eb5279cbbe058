"""Nearest rows of two sets of points, both ways, from one product of matrices."""

import numpy as np

from core.arrays import Floats, Ints

_ROWS = 1024
"""Rows of the first set whose products are held at a time."""


def nearest_both_ways(ours: Floats, theirs: Floats) -> tuple[Ints, Ints]:
    """The nearest row of `theirs` for each of `ours`, and the nearest of `ours` for each of `theirs`.

    Products are in single precision: of two rows that are equally near but for rounding either may be found.

    Parameters
    ----------
    ours, theirs : float64, shapes (n, k) and (m, k)

    Returns
    -------
    int64, shape (n,)
    int64, shape (m,)
    """
    # The unit of length, so that squares stay within single precision.
    scale = 1.0 / max(float(np.abs(ours).max()), float(np.abs(theirs).max()), np.finfo(np.float64).tiny)
    first, second = scale * ours, scale * theirs
    # The product of these rows is the squared distance.
    left = np.hstack([-2.0 * first, _squares(first), np.ones((len(first), 1))]).astype(np.float32)
    right = np.hstack([second, np.ones((len(second), 1)), _squares(second)]).astype(np.float32)
    there = np.empty(len(left), dtype=np.int64)
    block = np.zeros(len(right), dtype=np.int64)
    least = np.full(len(right), np.inf, dtype=np.float32)
    for start in range(0, len(left), _ROWS):
        gaps = left[start : start + _ROWS] @ right.T
        there[start : start + _ROWS] = gaps.argmin(axis=1)
        lowest = gaps.min(axis=0)
        nearer = lowest < least
        least[nearer], block[nearer] = lowest[nearer], start
    # The minimum of a column is fast, its place is not: it is looked for in the one block that has it.
    back = np.empty(len(right), dtype=np.int64)
    for start in range(0, len(left), _ROWS):
        own = np.flatnonzero(block == start)
        back[own] = start + (right[own] @ left[start : start + _ROWS].T).argmin(axis=1)
    return there, back


def _squares(rows: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", rows, rows)[:, None])
