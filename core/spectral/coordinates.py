"""Coordinates in the spectral domain (section 3.3)."""

import numpy as np

from core.arrays import Floats

FADED = 1e-6
"""A tapered column keeps so much of the largest squared weight: the spline needs every dimension."""


def spectral_coordinates(values: Floats, vectors: Floats, power: float, *, taper: bool = False) -> Floats:
    """Rows of the eigenvectors as points of the spectral domain, shape (m, k).

    Each column is multiplied by its eigenvalue's magnitude to the `power` (0: the paper's plain
    eigenvectors; 1/2: kernel principal components; -1/2 for a Laplacian: the global point signature).
    The cloud is then centred and scaled to unit root mean square radius.

    Where the last eigenvalue kept is close to the first left out, a small change of the shape swaps their
    vectors. Tapered, the square of each weight is lessened by that of the first eigenvalue left out, so that
    the last columns fade to nothing as the two come together.

    Parameters
    ----------
    values : float64, shape (s,), s >= k
        In order of importance; tapering needs s > k.
    vectors : float64, shape (m, k)
    power : float
    taper : bool
    """
    kept = vectors.shape[1]
    floor = 1e-9 * float(np.abs(values).max())
    squares = np.maximum(np.abs(values), floor) ** (2.0 * power)
    if taper:
        squares = np.maximum(squares - squares[kept], FADED * squares.max())
    points = vectors * np.sqrt(squares[:kept])
    points = points - points.mean(axis=0)
    return np.asarray(points / np.sqrt((points**2).sum(axis=1).mean()))
