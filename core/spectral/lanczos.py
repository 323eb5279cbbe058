"""The least eigenvalues of a factored matrix, by a block Lanczos method with its inverse.

G. Golub, R. Underwood, "The block Lanczos method for computing eigenvalues", 1977; R. Grimes, J. Lewis,
H. Simon, "A shifted block Lanczos algorithm for solving sparse symmetric generalized eigenproblems", SIAM
Journal on Matrix Analysis and Applications 15, 1994. There are no restarts: some 120 basis vectors give 30
eigenpairs, and their products are matrix products.

A block of b random vectors finds at most b copies of an eigenvalue. Where b equal eigenvalues are found there
may be more, and the search starts anew with twice as many vectors.
"""

import numpy as np
from numpy.linalg import LinAlgError

from core.arrays import Floats
from core.numerics.symmetric_factor import SymmetricFactor

BLOCK = 4
"""Vectors in the first block, as many as the factor's solver takes at a time."""

CONVERGED = 1e-12
"""Largest residual of an eigenpair of the inverse, relative to its eigenvalue. The relative error of a simple
eigenvalue is about its square, and that of a function is the residual over the relative gap."""

DECADES = 0.65
"""Decades by which a step reduces the residual of the last eigenpair, about. Convergence is checked after as
many steps as that asks for."""

EQUAL = 1e-6
"""Relative difference below which eigenvalues count as copies of one."""

LOST = 1e-12
"""Inner product of basis vectors above which they are made orthogonal again. Up to the square root of the
rounding error, 1e-8, the computed matrix is the exact one of the space but for rounding (H. Simon, "The
Lanczos algorithm with partial reorthogonalization", Mathematics of Computation 42, 1984)."""

DEPENDENT = 1e-3
"""Ratio of the least to the largest length in a block below which its Cholesky factor is too inaccurate."""


def least_eigenpairs(factor: SymmetricFactor, known: Floats, count: int) -> tuple[Floats, Floats]:
    """Return the least eigenpairs of a symmetric positive definite matrix, but for one that is known.

    Parameters
    ----------
    factor : SymmetricFactor
        Of the matrix, shape (n, n).
    known : float64, shape (n,)
        The unit eigenvector that is left out.
    count : int
        Less than n / 4.

    Returns
    -------
    float64, shape (count,)
        Eigenvalues, ascending, with all their copies.
    float64, shape (n, count)
        Orthonormal eigenvectors.

    Raises
    ------
    LinAlgError
        The eigenvalues do not converge: n may be too small for their copies, or more than a hundred
        eigenvalues are nearly equal.
    """
    block = BLOCK
    while True:
        values, vectors, copies = _by_blocks(factor, known, count, block)
        if copies < block:
            return 1.0 / values, vectors
        block *= 2


def _by_blocks(factor: SymmetricFactor, known: Floats, count: int, block: int) -> tuple[Floats, Floats, int]:
    """Eigenpairs of the inverse, and the largest number of equal eigenvalues.

    If that number reaches the block's size, the search ends, and not all eigenpairs have converged.
    """
    size = len(known)
    room = min(size, 10 * count + 40 * block)
    basis = np.empty((room, size))
    projected = np.zeros((room, room))
    basis[0] = known
    before, start, end = 1, 1, 1 + block
    random = np.random.default_rng(0).standard_normal((size, block))
    basis[start:end] = _orthonormal(random, basis[:start])[0]
    total = known.copy()
    check, lost = 3 * count + 4 * block, False
    while True:
        new = factor.solve(basis[start:end].T)
        near = basis[before:end]
        products = near @ new
        projected[before:end, start:end] = products
        new -= near.T @ products
        # Orthogonality is lost in the directions of converged eigenvectors, to which every basis vector
        # contributes: their sum shows it. A loss lasts for two blocks, as the recurrence reads both.
        total += basis[start:end].sum(axis=0)
        gram = new.T @ new
        again, lost = lost, bool(np.abs(total @ new).max() > LOST * np.sqrt(gram.diagonal().min()))
        if lost or again:
            new -= basis[:end].T @ (basis[:end] @ new)
            gram = new.T @ new
        following, lengths = _orthonormal_block(new, gram, basis[:end])
        if end >= check:
            values, mixed = np.linalg.eigh(projected[1:end, 1:end], UPLO="U")
            values, mixed = values[: -count - 1 : -1], mixed[:, : -count - 1 : -1]
            residuals = np.linalg.norm(lengths @ mixed[start - end :], axis=0) / values
            if not np.isfinite(residuals).all():
                raise LinAlgError("the basis is not finite")
            copies = _copies(values[residuals < CONVERGED])
            if copies >= block or (residuals < CONVERGED).all():
                return values, basis[1:end].T @ mixed, copies
            check = end + block * int(np.ceil(np.log10(residuals.max() / CONVERGED) / DECADES))
        if end + block > room:
            raise LinAlgError("the eigenvalues do not converge")
        before, start, end = start, end, end + block
        basis[start:end] = following


def _copies(values: Floats) -> int:
    """Return the largest number of equal values, given in descending order."""
    ends = np.flatnonzero(values[1:] < values[:-1] * (1.0 - EQUAL)) + 1
    return int(np.diff(ends, prepend=0, append=len(values)).max())


def _orthonormal_block(vectors: Floats, gram: Floats, basis: Floats) -> tuple[Floats, Floats]:
    """Orthonormal rows Q and an upper triangle R with Q^T R = vectors, for columns orthogonal to the basis.

    If the columns are nearly dependent, some rows of Q are other vectors orthogonal to the basis.
    """
    try:
        lower = np.asarray(np.linalg.cholesky(gram), dtype=np.float64)
    except LinAlgError:
        return _orthonormal(vectors, basis)
    if lower.diagonal().min() < DEPENDENT * lower.diagonal().max():
        return _orthonormal(vectors, basis)
    return np.linalg.inv(lower) @ vectors.T, lower.T


def _orthonormal(vectors: Floats, basis: Floats) -> tuple[Floats, Floats]:
    """As `_orthonormal_block`, for any vectors."""
    lengths = np.eye(vectors.shape[1])
    for _ in range(2):
        vectors, changed = np.linalg.qr(vectors - basis.T @ (basis @ vectors))
        lengths = changed @ lengths
    return vectors.T, lengths
