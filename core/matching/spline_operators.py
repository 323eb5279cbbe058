"""The linear operators of a thin-plate spline at its own points, one for each number of dimensions."""

import math

import numpy as np

from core.arrays import Float32s, Floats
from core.matching.thin_plate_spline import ThinPlateSpline, mean_pair_distance
from core.numerics.compilation import compiled

FLAT = 1e-12
"""The least eigenvalue over the greatest, of the cross-products of points beside ones, that are flat."""


def spline_operators(points: Floats, first_dimensions: int, stiffness: float) -> Float32s:
    """The operators S of the splines on one cloud: S targets are the values of the spline at the points.

    The TPS matcher reads these; they are the reference of `compiled_spline_operators`.

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
    return np.stack([ThinPlateSpline(points[:, :k], beta).smoother() for k in stages]).astype(np.float32)


def compiled_spline_operators(points: Floats, first_dimensions: int, stiffness: float) -> Floats:
    """The matrices of `spline_operators`, each from one bordered matrix inverted (Eq. 16).

    Compiled, and without the GIL, for the Procrustes matcher. Points that do not determine the affine part,
    as those in a plane, are left to `spline_operators`.

    Parameters
    ----------
    points : float64, shape (m, k)
    first_dimensions : int
    stiffness : float
        beta as a multiple of the mean distance between all pairs of points.

    Returns
    -------
    float64, shape (k - first_dimensions + 1, m, m)
        Symmetric, of entries in [-1, 1].
    """
    m, k = points.shape
    found = np.empty((k - first_dimensions + 1, m, m))
    if not _solved(np.array(points), first_dimensions, stiffness, found):
        return spline_operators(points, first_dimensions, stiffness).astype(np.float64)
    return found


@compiled
def _add_squares(column: Floats, squares: Floats) -> None:
    """Add the squared differences of one coordinate of m points to those between all pairs, shape (m, m)."""
    for i in range(len(column)):
        for j in range(len(column)):
            squares[i, j] += (column[i] - column[j]) ** 2


@compiled
def _solved(points: Floats, first: int, stiffness: float, found: Floats) -> bool:
    """Write the matrices, unless the points are flat."""
    m, k = points.shape
    affine = np.ones((m, k + 1))
    for c in range(k):
        size = math.sqrt((points[:, c] ** 2).sum())
        if size == 0.0:
            return False
        affine[:, c + 1] = points[:, c] / size
    affine[:, 0] /= math.sqrt(m)
    spread = np.linalg.eigvalsh(np.dot(affine.T, affine))
    if not spread[0] > FLAT * spread[-1]:
        return False
    columns = np.ascontiguousarray(points.T)
    squares = np.zeros((m, m))
    for c in range(k):
        _add_squares(columns[c], squares)
    total = 0.0
    for i in range(m):
        for j in range(i):
            total += 2.0 * math.sqrt(squares[i, j])
    beta = stiffness * total / (m * (m - 1))
    squares[:] = 0.0
    for c in range(k):
        _add_squares(columns[c], squares)
        if c + 1 < first:
            continue
        bordered = np.zeros((m + c + 2, m + c + 2))
        for i in range(m):
            for j in range(i):
                if squares[i, j] > 0.0:
                    bordered[i, j] = bordered[j, i] = squares[i, j] * math.log(squares[i, j])
            bordered[i, i] = beta
            for d in range(c + 2):
                bordered[i, m + d] = bordered[m + d, i] = affine[i, d]
        inverse = np.linalg.inv(bordered)
        for i in range(m):
            for j in range(m):
                found[c + 1 - first, i, j] = -0.5 * beta * (inverse[i, j] + inverse[j, i])
            found[c + 1 - first, i, i] += 1.0
    return True
