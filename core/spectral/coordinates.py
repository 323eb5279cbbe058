"""Spectral coordinates of the points (section 3.3), and eigenvalue signatures, which shortlists compare."""

import numpy as np

from core.arrays import Floats

FADED = 1e-6
"""Least squared weight of a tapered column, over the largest; the spline needs every dimension."""

FAINTEST = 1e-2
"""Lower limit of an eigenvalue times the area; a tube a thousand times as long as wide has 0.03."""


def spectral_coordinates(values: Floats, vectors: Floats, power: float, *, taper: bool = False) -> Floats:
    """Return the rows of the eigenvectors as points of the spectral domain, shape (m, k).

    Each column is multiplied by its eigenvalue's magnitude to the `power` (0: the paper's plain
    eigenvectors; 1/2: kernel principal components; -1/2 for a Laplacian: the global point signature). The
    points are then centred and scaled to unit root mean square radius.

    If the last eigenvalue kept is close to the first one dropped, a small change of the shape swaps their
    eigenvectors. Tapering subtracts the squared weight of the first eigenvalue dropped from each squared
    weight, so the last columns fade out as the two eigenvalues meet.

    Parameters
    ----------
    values : float64, shape (s,), s >= k
        Eigenvalues by descending importance; tapering needs s > k.
    vectors : float64, shape (m, k)
        Eigenvectors in columns.
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


def affinity_signature(values: Floats) -> Floats:
    """Return the logarithms of the leading eigenvalues' magnitudes over the root of their number, shape (s,).

    The values are eigenvalues over the number of samples, or of the integral operator: those of a Gaussian
    affinity sum to at most 1, so shapes with different numbers of samples are comparable.
    """
    return np.asarray(np.log(np.maximum(np.abs(values), 1e-6)) / np.sqrt(max(1, len(values))))


def laplacian_signature(values: Floats, area: float) -> Floats:
    """Return the logarithms of eigenvalues times the area, over the root of their number, shape (s,).

    This is ShapeDNA (Reuter, Wolter, Peinecke 2006), normalised by the area. Its authors divide by the first
    eigenvalue, which a thin neck or a loose component changes most. The Euclidean distance of two signatures
    is the root mean square difference of logarithms, for any s. The values, ascending, are those after that
    of the constant function; the area is > 0.
    """
    return np.asarray(np.log(np.maximum(values * area, FAINTEST)) / np.sqrt(max(1, len(values))))
