"""What a thin-plate spline makes of targets at its own points, a matrix for each number of dimensions."""

import numpy as np

from core.correspondence import smoothers
from core.mesh import Floats

OPEN = 1e-9
"""The least singular value of the points beside ones, over the greatest, under which they are flat."""


def smoothing(points: Floats, first_dimensions: int, stiffness: float) -> Floats:
    """The matrices of `core.correspondence.smoothers`, all from one inversion of bordered matrices (Eq. 16).

    Points that leave the affine part open, as those in a plane do, are left to that function.

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
    stages = np.arange(first_dimensions, k + 1)
    squares = np.empty((len(stages), m, m))
    between = np.zeros((m, m))
    for c, column in enumerate(points.T):
        between += np.subtract.outer(column, column) ** 2
        if c + 1 >= first_dimensions:
            squares[c + 1 - first_dimensions] = between
    beta = stiffness * float(np.sqrt(between).sum()) / (m * (m - 1))
    bordered = np.zeros((len(stages), m + k + 1, m + k + 1))
    bordered[:, :m, :m] = squares * np.log(np.maximum(squares, 1e-300))
    bordered[:, np.arange(m), np.arange(m)] += beta
    affine = np.concatenate([np.ones((m, 1)), points], axis=1)
    affine /= np.maximum(np.linalg.norm(affine, axis=0), 1e-300)
    spread = np.linalg.svd(affine, compute_uv=False)
    if not spread[-1] > OPEN * spread[0]:
        return smoothers(points, first_dimensions, stiffness).astype(np.float64)
    for place, count in enumerate(stages):
        own = slice(m, m + count + 1)
        bordered[place, :m, own] = affine[:, : count + 1]
        bordered[place, own, :m] = affine[:, : count + 1].T
        rest = np.arange(m + count + 1, m + k + 1)
        bordered[place, rest, rest] = 1.0
    found = np.eye(m) - beta * np.linalg.inv(bordered)[:, :m, :m]
    return np.asarray(0.5 * (found + found.transpose(0, 2, 1)))
