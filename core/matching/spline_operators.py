"""What a thin-plate spline makes of targets at its own points, a matrix for each number of dimensions."""

import math

import numpy as np

from core.arrays import Floats
from core.matching.correspondence import smoothers
from core.numerics.compilation import compiled

FLAT = 1e-12
"""The least eigenvalue over the greatest, of the cross-products of points beside ones, that are flat."""


def smoothing(points: Floats, first_dimensions: int, stiffness: float) -> Floats:
    """The matrices of `core.matching.correspondence.smoothers`, each from one bordered matrix inverted (Eq. 16).

    Compiled, and without the GIL. Points that leave the affine part open, as those in a plane do, are left to
    that function.

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
        return smoothers(points, first_dimensions, stiffness).astype(np.float64)
    return found


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
    squares = np.zeros((m, m))
    total = 0.0
    for i in range(m):
        for j in range(m):
            descriptor_distance = 0.0
            for c in range(k):
                descriptor_distance += (points[i, c] - points[j, c]) ** 2
            total += math.sqrt(descriptor_distance)
    beta = stiffness * total / (m * (m - 1))
    for c in range(k):
        for i in range(m):
            for j in range(m):
                squares[i, j] += (points[i, c] - points[j, c]) ** 2
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
