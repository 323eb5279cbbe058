"""The least eigenvalues of a sparse symmetric positive definite matrix, by a block Lanczos method.

QDLDL finds an order of minimum degree and the factors L D L^T (B. Stellato, G. Banjac, P. Goulart,
A. Bemporad, S. Boyd, "OSQP: an operator splitting solver for quadratic programs", Mathematical Programming
Computation 12, 2020); the method multiplies by the inverse.
G. Golub, R. Underwood, "The block Lanczos method for computing eigenvalues", 1977; R. Grimes, J. Lewis,
H. Simon, "A shifted block Lanczos algorithm for solving sparse symmetric generalized eigenproblems", SIAM
Journal on Matrix Analysis and Applications 15, 1994. There are no restarts: some 120 basis vectors give 30
eigenpairs, and their products are matrix products.

A block of b random vectors finds at most b copies of an eigenvalue. Where b equal eigenvalues are found there
may be more, and the search starts anew with twice as many vectors.
"""

import numpy as np
import qdldl
from numpy.linalg import LinAlgError
from numpy.typing import NDArray
from scipy.linalg import eigvals_banded
from scipy.sparse import csc_array, csc_matrix

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled_fused

BLOCK = 4
"""Vectors in the first block, as many as a solution takes at a time."""

CONVERGED = 1e-12
"""Largest residual of an eigenpair of the inverse, relative to its eigenvalue. The relative error of a simple
eigenvalue is about its square, and that of a function is the residual over the relative gap."""

DECADES = 0.65
"""Decades by which a step reduces the residual of the last eigenpair, about. Convergence is checked after as
many steps as that asks for."""

SPACE = 2.0
"""Basis vectors for each of many eigenvalues without eigenvectors. Their relative error is 2e-3 in the mean;
the last tenth have up to 0.05. Of a value of more copies than the block has vectors some are missed, which
moves those that follow."""

EQUAL = 1e-6
"""Relative difference below which eigenvalues count as copies of one."""

LOST, LOST_LATER = 1e-12, 1e-5
"""Inner products of basis vectors above which they are made orthogonal again, until the eigenpairs converge,
and later. The computed matrix is the exact one of the space but for the square of the loss, 1e-10 (H. Simon,
"The Lanczos algorithm with partial reorthogonalization", Mathematics of Computation 42, 1984)."""

CACHED = 120_000
"""Numbers of the basis read at a time, so that both products find them in the cache of a processor."""

DEPENDENT = 1e-3
"""Ratio of the least to the largest length in a block below which its Cholesky factor is too inaccurate."""


ONE = np.uint64(1)
"""Unsigned, because a signed and an unsigned number add up to a float in compiled code."""


class SymmetricFactor:
    """The factors of a sparse symmetric positive definite matrix, whose part below the diagonal is not read.

    Raise RuntimeError if it is not positive definite.
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
        # Unsigned: a signed index is checked for its sign at each access.
        self._starts = lower.indptr.astype(np.uint64)
        self._rows = lower.indices.astype(np.uint32)
        self._values = lower.data
        self._inverse = 1.0 / diagonal
        self._order = np.array(order, dtype=np.int64)

    def solve(self, right: Floats) -> Floats:
        """Return the solution x of A x = b, of shape (n,) or (n, c); raise ValueError for another length."""
        if len(right) != len(self._inverse):
            raise ValueError(f"{len(right)} rows for a matrix of {len(self._inverse)}")
        solution = np.array(right.reshape(len(right), -1), dtype=np.float64, order="F")
        _solve(self._starts, self._rows, self._values, self._inverse, self._order, solution)
        return solution.reshape(right.shape)


@compiled_fused
def _solve(
    starts: NDArray[np.uint64],
    rows: NDArray[np.uint32],
    values: Floats,
    inverse: Floats,
    order: Ints,
    solution: Floats,
) -> None:
    """Replace b, shape (n, c), by the solution of A x = b, four columns at a time.

    A solution with `qdldl.Solver.solve`, which takes one column, takes twice as long for each. `starts` tells
    where the entries of each column of L begin; `rows` and `values` are those below the unit diagonal, shape
    (e,); `inverse` is 1 / D; `order` has the row of A that each row of the factors is.
    """
    count, columns = solution.shape
    x = np.zeros((count, 4))
    for first in range(0, columns, 4):
        width = min(4, columns - first)
        for j in range(count):
            for c in range(width):
                x[j, c] = solution[order[j], first + c]
        # L y = b, column after column.
        for j in range(count):
            x0, x1, x2, x3 = x[j, 0], x[j, 1], x[j, 2], x[j, 3]
            for entry in range(starts[j], starts[j + 1]):
                row, value = rows[entry], values[entry]
                x[row, 0] -= value * x0
                x[row, 1] -= value * x1
                x[row, 2] -= value * x2
                x[row, 3] -= value * x3
        # L^T x = D^-1 y, from the last row.
        for j in range(count - 1, -1, -1):
            x0, x1, x2, x3 = x[j, 0], x[j, 1], x[j, 2], x[j, 3]
            scale = inverse[j]
            x0, x1, x2, x3 = scale * x0, scale * x1, scale * x2, scale * x3
            # Two sums, so that an addition need not wait for the last.
            y0, y1, y2, y3 = 0.0, 0.0, 0.0, 0.0
            entry, last = starts[j], starts[j + 1]
            while entry + ONE < last:
                row, value = rows[entry], values[entry]
                x0 -= value * x[row, 0]
                x1 -= value * x[row, 1]
                x2 -= value * x[row, 2]
                x3 -= value * x[row, 3]
                row, value = rows[entry + ONE], values[entry + ONE]
                y0 -= value * x[row, 0]
                y1 -= value * x[row, 1]
                y2 -= value * x[row, 2]
                y3 -= value * x[row, 3]
                entry += ONE + ONE
            x0, x1, x2, x3 = x0 + y0, x1 + y1, x2 + y2, x3 + y3
            if entry < last:
                row, value = rows[entry], values[entry]
                x0 -= value * x[row, 0]
                x1 -= value * x[row, 1]
                x2 -= value * x[row, 2]
                x3 -= value * x[row, 3]
            x[j, 0], x[j, 1], x[j, 2], x[j, 3] = x0, x1, x2, x3
        for j in range(count):
            for c in range(width):
                solution[order[j], first + c] = x[j, c]


def least_eigenpairs(
    factor: SymmetricFactor, known: Floats, count: int, more: int = 0
) -> tuple[Floats, Floats, Floats]:
    """Return the least eigenpairs of a symmetric positive definite matrix, but for one that is known.

    `known` is the unit eigenvector that is left out, shape (n,); count < n / 4. Eigenvalues, shape (count,),
    ascend, with all their copies; eigenvectors are orthonormal columns, shape (n, count). The third array has
    the first `more` eigenvalues, or fewer if n is less, ascending; `SPACE` tells their error. Raise
    LinAlgError if the eigenvalues do not converge: n may be too small for their copies, or more than a
    hundred of them are nearly equal.
    """
    block = BLOCK
    while True:
        values, vectors, copies, spectrum = _by_blocks(factor, known, count, block, more)
        if copies < block:
            return 1.0 / values, vectors, 1.0 / spectrum
        block *= 2


def _by_blocks(
    factor: SymmetricFactor, known: Floats, count: int, block: int, more: int
) -> tuple[Floats, Floats, int, Floats]:
    """Return eigenpairs of the inverse, the largest number of equal eigenvalues, and `more` eigenvalues.

    If that number reaches the block's size, the search ends, and not all eigenpairs have converged.
    """
    size = len(known)
    last = min(int(SPACE * more), size - block)
    room = min(size, max(10 * count + 40 * block, last + block))
    basis, few_rows = np.empty((room, size)), 1 + CACHED // size
    projected = np.zeros((room, room))
    basis[0] = known
    before, start, end = 1, 1, 1 + block
    random = np.random.default_rng(0).standard_normal((size, block)).T
    basis[start:end] = _orthonormal(random, basis[:start])[0]
    total = known.copy()
    check, lost = 3 * count + 4 * block, False
    found: tuple[Floats, Floats, int] | None = None
    while found is None or end < last:
        # The next block: the inverse times the last one, less its parts in the last two.
        new = factor.solve(basis[start:end].T).T
        near = basis[before:end]
        products = new @ near.T
        projected[before:end, start:end] = products.T
        new -= products @ near
        # Orthogonality is lost in the directions of converged eigenvectors, to which every basis vector
        # contributes: their sum shows it. A loss lasts for two blocks, as the recurrence reads both.
        total += basis[start:end].sum(axis=0)
        gram = new @ new.T
        limit = (LOST if found is None else LOST_LATER) * np.sqrt(gram.diagonal().min())
        again, lost = lost, bool(np.abs(new @ total).max() > limit)
        if lost or again:
            for first in range(0, end, few_rows):
                few = basis[first : min(end, first + few_rows)]
                new -= (new @ few.T) @ few
            gram = new @ new.T
        # Orthonormal vectors of the block.
        following, lengths = _orthonormal_block(new, gram, basis[:end])
        if found is None and end >= check:
            # Ritz pairs, and their residuals from the coupling with the block that follows.
            values, mixed = np.linalg.eigh(projected[1:end, 1:end], UPLO="U")
            values, mixed = values[: -count - 1 : -1], mixed[:, : -count - 1 : -1]
            residuals = np.linalg.norm(lengths @ mixed[start - end :], axis=0) / values
            if not np.isfinite(residuals).all():
                raise LinAlgError("the basis is not finite")
            copies = _copies(values[residuals < CONVERGED])
            if copies >= block:
                return values, values, copies, values
            if (residuals < CONVERGED).all():
                found = values, basis[1:end].T @ mixed, copies
            check = end + block * int(np.ceil(np.log10(residuals.max() / CONVERGED) / DECADES))
        if end + block > room:
            raise LinAlgError("the eigenvalues do not converge")
        before, start, end = start, end, end + block
        basis[start:end] = following
    # Blocks are coupled by triangles, so the matrix is a band.
    band = np.zeros((block + 1, start - 1))
    for above in range(block + 1):
        band[block - above, above:] = projected[1:start, 1:start].diagonal(above)
    values = eigvals_banded(band, overwrite_a_band=True, check_finite=False)[: -more - 1 : -1]
    return *found, np.asarray(values, dtype=np.float64)


def _copies(values: Floats) -> int:
    """Return the largest number of equal values, given in descending order."""
    ends = np.flatnonzero(values[1:] < values[:-1] * (1.0 - EQUAL)) + 1
    return int(np.diff(ends, prepend=0, append=len(values)).max())


def _orthonormal_block(vectors: Floats, gram: Floats, basis: Floats) -> tuple[Floats, Floats]:
    """Return orthonormal rows Q and an upper triangle R with R^T Q = vectors.

    The rows are orthogonal to the basis. If they are nearly dependent, some rows of Q are other vectors
    orthogonal to the basis.
    """
    try:
        lower = np.asarray(np.linalg.cholesky(gram), dtype=np.float64)
    except LinAlgError:
        return _orthonormal(vectors, basis)
    if lower.diagonal().min() < DEPENDENT * lower.diagonal().max():
        return _orthonormal(vectors, basis)
    return np.linalg.inv(lower) @ vectors, lower.T


def _orthonormal(vectors: Floats, basis: Floats) -> tuple[Floats, Floats]:
    """Return what `_orthonormal_block` returns, for any vectors."""
    lengths = np.eye(len(vectors))
    for _ in range(2):
        columns, changed = np.linalg.qr((vectors - (vectors @ basis.T) @ basis).T)
        vectors, lengths = columns.T, changed @ lengths
    return vectors, lengths
