"""Nearest rows of two sets of points, both ways, from one product of matrices."""

import numpy as np

from core.arrays import Float32s, Floats, Ints

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
    first, second = (np.ascontiguousarray(scale * rows, dtype=np.float32) for rows in (ours, theirs))
    lengths, other_lengths = _squares(first), _squares(second)
    there = np.empty(len(first), dtype=np.int64)
    back = np.zeros(len(second), dtype=np.int64)
    best = np.full(len(second), np.inf, dtype=np.float32)
    for start in range(0, len(first), _ROWS):
        part = slice(start, start + _ROWS)
        gaps = first[part] @ second.T
        gaps *= np.float32(-2.0)
        gaps += other_lengths
        there[part] = gaps.argmin(axis=1)
        gaps += lengths[part, None]
        rows = gaps.argmin(axis=0)
        least = gaps[rows, np.arange(len(second))]
        nearer = least < best
        best[nearer], back[nearer] = least[nearer], start + rows[nearer]
    return there, back


def _squares(rows: Float32s) -> Float32s:
    return np.asarray(np.einsum("ij,ij->i", rows, rows))
