"""The factorisation L D L^T of a sparse symmetric positive definite matrix, and solutions with it.

SuperLU finds the order and the factors. This solver reads L only, and takes a third of the time of SuperLU's.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled
from core.numerics.simd import SIMD_WIDTH, gather, scatter

Indices = NDArray[np.uint32]
"""Of half the size of signed ones, for less memory that a solution reads."""


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
        self._starts = lower.indptr - np.arange(len(lower.indptr))
        self._rows = lower.indices[below].astype(np.uint32)
        self._values = lower.data[below]
        self._inverse = 1.0 / diagonal
        self._order = factor.perm_c.astype(np.int64)

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
        solution = np.empty(columns.T.shape)
        _solve(self._starts, self._rows, self._values, self._inverse, self._order, columns, solution)
        return solution.reshape(right.shape)


@compiled
def _solve(
    starts: Ints,
    rows: Indices,
    values: Floats,
    inverse: Floats,
    order: Ints,
    right: Floats,
    solution: Floats,
) -> None:
    """Fill `solution`, shape (n, c), SIMD_WIDTH columns at a time; `right` has shape (c, n)."""
    count, columns = len(inverse), len(right)
    x = np.empty(SIMD_WIDTH * count)
    for first in range(0, columns, SIMD_WIDTH):
        width = min(SIMD_WIDTH, columns - first)
        for c in range(SIMD_WIDTH):
            column = right[first + min(c, width - 1)]
            for i in range(count):
                x[SIMD_WIDTH * order[i] + c] = column[i]
        for j in range(count):
            scatter(x, rows, values, j, starts[j], starts[j + 1])
        for j in range(count - 1, -1, -1):
            gather(x, rows, values, j, starts[j], starts[j + 1], inverse[j])
        for i in range(count):
            for c in range(width):
                solution[i, first + c] = x[SIMD_WIDTH * order[i] + c]
