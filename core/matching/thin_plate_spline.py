"""The linear operators of thin-plate splines at their own points, Eqs. 14-16."""

import math

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from core.arrays import Float32s, Floats
from core.errors import ParameterError
from core.numerics.compilation import compiled

VECTORS = 16
"""Numbers of one turn of a loop in SIMD registers."""

LEAST_SPREAD = 1e-12
"""The least eigenvalue over the greatest, of the cross-products of flat points beside ones."""


def tps_kernel(first: Floats, second: Floats) -> Floats:
    """Return phi(r) = r^2 log r^2 between points, shape (m, n).

    In two dimensions it gives the minimiser of Eq. 14's bending energy; in k >= 3 it is simply a
    conditionally positive definite kernel of order two.
    """
    squares = np.maximum(((first[:, None, :] - second[None, :, :]) ** 2).sum(axis=2), 0.0)
    return np.asarray(np.where(squares > 0.0, squares * np.log(np.maximum(squares, 1e-300)), 0.0))


def mean_pair_distance(points: Floats) -> float:
    """Return the mean distance of all pairs of points, shape (m, k): the paper's choice for beta."""
    distances = np.sqrt(((points[:, None, :] - points[None, :, :]) ** 2).sum(axis=2))
    count = len(points)
    return float(distances.sum()) / (count * (count - 1))


def smoother(source: Floats, beta: float) -> Floats:
    """Return S, shape (m, m): S @ targets are the values at the source points of the spline to the targets.

    Eq. 16 with the beta that it omits: [K + beta I, P; P^T, 0] [w; t] = [targets; 0], P = [1, source]. The
    null-space form is solved: w = Q2 (Q2^T (K + beta I) Q2)^-1 Q2^T targets, Q2 an orthonormal basis of the
    vectors that P^T takes to zero, so that the affine part is exact whatever beta is. The values K w + P t
    are targets - beta w. Beta (Eq. 14) 0 interpolates, infinity leaves the affine least-squares fit.

    Raise ParameterError if beta is negative, if m < k + 2, or if beta is 0 and points, shape (m, k),
    coincide.
    """
    count, dimensions = source.shape
    if not beta >= 0.0:
        raise ParameterError(f"beta must not be negative, but is {beta}")
    if count < dimensions + 2:
        raise ParameterError(f"a spline in {dimensions} dimensions needs {dimensions + 2} points")
    if beta == 0.0 and len(np.unique(source, axis=0)) < count:
        raise ParameterError("points coincide, so beta must be positive")
    affine = np.concatenate([np.ones((count, 1)), source], axis=1)
    bending = np.linalg.qr(affine, mode="complete")[0][:, dimensions + 1 :]
    inner = bending.T @ tps_kernel(source, source) @ bending
    inner[np.diag_indices_from(inner)] += beta
    try:
        factor = cho_factor(0.5 * (inner + inner.T), check_finite=False)
    except LinAlgError as error:
        raise ParameterError("points nearly coincide, so beta must be larger") from error
    warping = bending @ cho_solve(factor, bending.T, check_finite=False)
    return np.asarray(np.eye(count) - beta * warping)


def spline_operators(points: Floats, first_dimensions: int, stiffness: float) -> Float32s:
    """Return the operators S of the splines on one cloud, one for each number of dimensions.

    S targets are the values of the spline at the points. The TPS matcher reads these; they are the reference
    of `compiled_spline_operators`.

    Parameters
    ----------
    points : float64, shape (m, k)
    first_dimensions : int
        Dimensions of the first operator; each of the others has one dimension more.
    stiffness : float
        beta as a multiple of the mean distance between all pairs of points.

    Returns
    -------
    float32, shape (k - first_dimensions + 1, m, m)
    """
    beta = stiffness * mean_pair_distance(points)
    stages = range(first_dimensions, points.shape[1] + 1)
    return np.stack([smoother(points[:, :k], beta) for k in stages]).astype(np.float32)


def compiled_spline_operators(points: Floats, first_dimensions: int, stiffness: float) -> Floats:
    """Return the matrices of `spline_operators`, each from one symmetric matrix inverted.

    Compiled, and without the GIL, for the Procrustes matcher. Points that do not determine the affine part,
    as those in a plane, are left to `spline_operators`. The matrices are symmetric, of entries in [-1, 1].
    """
    m, k = points.shape
    operators = np.empty((k - first_dimensions + 1, m, m))
    if not _solved(np.array(points), first_dimensions, stiffness, operators):
        return spline_operators(points, first_dimensions, stiffness).astype(np.float64)
    return operators


@compiled
def _add_squares(column: Floats, squares: Floats) -> None:
    """Add the squared differences of one coordinate of m points to those below the diagonal, shape (m, m)."""
    for i in range(len(column)):
        for j in range(i):
            squares[i, j] += (column[i] - column[j]) ** 2


@compiled
def _inverted(matrix: Floats) -> bool:
    """Invert a symmetric positive definite matrix in its lower triangle; return whether it is one.

    By the sweep operator (J. H. Goodnight, The American Statistician 33, 1979), two pivots at a time, in
    about half of the time of `np.linalg.inv` for a hundred rows. Numbers above the diagonal are overwritten.
    """
    n = len(matrix)
    first, second = np.zeros(n), np.zeros(n)
    for pivot in range(0, n, 2):
        following = pivot + 1
        # The columns of both pivots, from the lower triangle, the second as the first one's sweep leaves it.
        _read_column(matrix, pivot, first)
        if not first[pivot] > 0.0:
            return False
        scale, next_scale, link = 1.0 / first[pivot], 0.0, 0.0
        if following < n:
            _read_column(matrix, following, second)
            link = first[following] * scale
            for j in range(n):
                second[j] -= link * first[j]
            second[pivot] = link
            if not second[following] > 0.0:
                return False
            next_scale = 1.0 / second[following]
        else:
            second[:] = 0.0
        for i in range(n):
            factor, next_factor = first[i] * scale, second[i] * next_scale
            # Whole vectors: a short loop takes most of its time after the last of them.
            for j in range(min((i // VECTORS + 1) * VECTORS, n)):
                matrix[i, j] -= factor * first[j] + next_factor * second[j]
        # The rows of the pivots.
        for j in range(n):
            first[j] = first[j] * scale - second[j] * (link * next_scale)
            second[j] *= next_scale
        first[pivot] = -scale - link * link * next_scale
        _write_column(first, pivot, matrix)
        if following < n:
            second[following] = -next_scale
            _write_column(second, following, matrix)
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = -matrix[i, j]
    return True


@compiled
def _read_column(matrix: Floats, column: int, entries: Floats) -> None:
    """Write a column of a symmetric matrix, from its lower triangle."""
    for j in range(len(matrix)):
        entries[j] = matrix[column, j] if j <= column else matrix[j, column]


@compiled
def _write_column(entries: Floats, column: int, matrix: Floats) -> None:
    """Write a column of a symmetric matrix into its lower triangle."""
    for j in range(len(matrix)):
        if j <= column:
            matrix[column, j] = entries[j]
        else:
            matrix[j, column] = entries[j]


@compiled
def _solved(points: Floats, first: int, stiffness: float, operators: Floats) -> bool:
    """Write the matrices, and return whether the points are not flat."""
    m, k = points.shape
    # Ones beside the coordinates, each column of unit length.
    affine = np.ones((m, k + 1))
    for c in range(k):
        size = math.sqrt((points[:, c] ** 2).sum())
        if size == 0.0:
            return False
        affine[:, c + 1] = points[:, c] / size
    affine[:, 0] /= math.sqrt(m)
    spread = np.linalg.eigvalsh(np.dot(affine.T, affine))
    if not spread[0] > LEAST_SPREAD * spread[-1]:
        return False
    orthonormal = np.linalg.qr(affine)[0]
    columns = np.ascontiguousarray(points.T)
    squares = np.zeros((m, m))
    for c in range(k):
        _add_squares(columns[c], squares)
    # beta, from the mean distance in all dimensions.
    total = 0.0
    for i in range(m):
        for j in range(i):
            total += 2.0 * math.sqrt(squares[i, j])
    beta = stiffness * total / (m * (m - 1))
    # For each number of dimensions: K + beta I, the affine part projected away on both sides, and inverted.
    squares[:] = 0.0
    for c in range(k):
        _add_squares(columns[c], squares)
        if c + 1 < first:
            continue
        bending = np.zeros((m, m))
        for i in range(m):
            for j in range(i):
                if squares[i, j] > 0.0:
                    bending[i, j] = bending[j, i] = squares[i, j] * math.log(squares[i, j])
        basis = np.ascontiguousarray(orthonormal[:, : c + 2])
        across = np.ascontiguousarray(basis.T)
        part = np.dot(bending, basis)
        part -= 0.5 * np.dot(basis, np.dot(across, part))
        affine_part = np.dot(part, across)
        for i in range(m):
            for j in range(i + 1):
                bending[i, j] -= affine_part[i, j] + affine_part[j, i]
            bending[i, i] += beta
        if not _inverted(bending):
            return False
        # I - beta times the inverse, less what is 1 / beta in it: the projection onto the affine part.
        fitted = np.dot(basis, across)
        for i in range(m):
            for j in range(i + 1):
                entry = fitted[i, j] - beta * bending[i, j]
                operators[c + 1 - first, i, j] = operators[c + 1 - first, j, i] = entry
            operators[c + 1 - first, i, i] += 1.0
    return True
