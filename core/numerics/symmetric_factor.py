"""The factorisation L D L^T of a sparse symmetric positive definite matrix, and solutions with it.

QDLDL finds an order of minimum degree and the factors (B. Stellato, G. Banjac, P. Goulart, A. Bemporad,
S. Boyd, "OSQP: an operator splitting solver for quadratic programs", Mathematical Programming Computation 12,
2020). The solver here takes several right-hand sides at a time.
"""

import numpy as np
import qdldl
from scipy.sparse import csc_array, csc_matrix

from core.arrays import Floats
from core.numerics.triangular_solve import solve


class SymmetricFactor:
    """The factors of a sparse symmetric positive definite matrix.

    Parameters
    ----------
    matrix : csc_array, shape (n, n)
        The part below the diagonal is not read.

    Raises
    ------
    RuntimeError
        The matrix is not positive definite.
    """

    def __init__(self, matrix: csc_array) -> None:
        size = matrix.shape[0]
        upper = matrix.indices <= np.repeat(np.arange(size), np.diff(matrix.indptr))
        starts = np.concatenate([[0], np.cumsum(upper)])[matrix.indptr]
        kept = csc_matrix((matrix.data[upper], matrix.indices[upper], starts), shape=matrix.shape)
        try:
            lower, diagonal, order = qdldl.Solver(kept, upper=True).factors()
        except (RuntimeError, ValueError) as error:
            raise RuntimeError("the matrix is not positive definite") from error
        if not (diagonal > 0.0).all():
            raise RuntimeError("the matrix is not positive definite")
        self._starts = lower.indptr.astype(np.int64)
        self._rows = lower.indices.astype(np.uint32)
        self._values = lower.data
        self._inverse = 1.0 / diagonal
        self._place = np.empty(size, dtype=np.int64)
        self._place[order] = np.arange(size)

    def solve(self, right: Floats) -> Floats:
        """Return the solution x of A x = b, for b of shape (n,) or, a column each, (n, c).

        Raises
        ------
        ValueError
            b has another length.
        """
        if len(right) != len(self._inverse):
            raise ValueError(f"{len(right)} rows for a matrix of {len(self._inverse)}")
        columns = np.ascontiguousarray(np.atleast_2d(right.T))
        solution = np.empty(columns.T.shape)
        solve(self._starts, self._rows, self._values, self._inverse, self._place, columns, solution)
        return solution.reshape(right.shape)
