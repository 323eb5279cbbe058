"""The factorisation L D L^T of a sparse symmetric positive definite matrix, and solutions with it.

SuperLU finds the order and the factors. This solver reads L only, and takes a third of the time of SuperLU's.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from core.arrays import Floats
from core.numerics.compilation import compiled

Indices = NDArray[np.uint32]
"""Unsigned: numba checks signed indices for negative ones, which count from the end."""


class SymmetricFactor:
    """The factors of a sparse symmetric positive definite matrix.

    Parameters
    ----------
    matrix : csc_array, shape (n, n)

    Raises
    ------
    RuntimeError
        The matrix is not positive definite.
    """

    def __init__(self, matrix: csc_array) -> None:
        # A positive definite matrix needs no pivoting. The fill of a surface's matrix is so small that wider
        # panels and relaxed supernodes take longer.
        factor = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            relax=1,
            panel_size=1,
            options={"SymmetricMode": True},
        )
        lower, diagonal = factor.L, factor.U.diagonal()
        if not ((diagonal > 0.0).all() and np.array_equal(factor.perm_r, factor.perm_c)):
            raise RuntimeError("the matrix is not positive definite")
        lower.sort_indices()
        # The first entry of each column is the unit diagonal.
        below = np.ones(lower.nnz, dtype=bool)
        below[lower.indptr[:-1]] = False
        self._starts = (lower.indptr - np.arange(len(lower.indptr))).astype(np.uint32)
        self._rows = lower.indices[below].astype(np.uint32)
        self._values = lower.data[below]
        self._inverse = 1.0 / diagonal
        self._order = factor.perm_c.astype(np.uint32)

    def solve(self, right: Floats) -> Floats:
        """The solution x of A x = b, for b of shape (n,) or, a column each, (n, c).

        Raises
        ------
        ValueError
            b has another length.
        """
        if len(right) != len(self._inverse):
            raise ValueError(f"{len(right)} rows for a matrix of {len(self._inverse)}")
        columns = np.ascontiguousarray(np.atleast_2d(right.T))
        solution = np.empty_like(columns)
        _solve(self._starts, self._rows, self._values, self._inverse, self._order, columns, solution)
        return solution.T.reshape(right.shape)


@compiled
def _solve(
    starts: Indices,
    rows: Indices,
    values: Floats,
    inverse: Floats,
    order: Indices,
    right: Floats,
    solution: Floats,
) -> None:
    """Fill `solution`, shape (c, n); four sums at a time, so that an addition need not wait for the last."""
    count = len(inverse)
    x = np.empty(count)
    for c in range(len(right)):
        for i in range(count):
            x[order[i]] = right[c, i]
        for j in range(count):
            known = x[j]
            for e in range(starts[j], starts[j + 1]):
                x[rows[e]] -= values[e] * known
        for j in range(count - 1, -1, -1):
            first, second, third, fourth = x[j] * inverse[j], 0.0, 0.0, 0.0
            e, end = starts[j], starts[j + 1]
            while e + 3 < end:
                first -= values[e] * x[rows[e]]
                second -= values[e + 1] * x[rows[e + 1]]
                third -= values[e + 2] * x[rows[e + 2]]
                fourth -= values[e + 3] * x[rows[e + 3]]
                e += 4
            while e < end:
                first -= values[e] * x[rows[e]]
                e += 1
            x[j] = (first + second) + (third + fourth)
        for i in range(count):
            solution[c, i] = x[order[i]]
