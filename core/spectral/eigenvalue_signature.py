"""Eigenvalue signatures, the vectors by which shapes are shortlisted."""

import numpy as np

from core.arrays import Floats

FAINTEST = 1e-2
"""Lower limit of an eigenvalue times the area; a tube a thousand times as long as wide has 0.03."""


def affinity_signature(values: Floats) -> Floats:
    """Return the logarithms of the leading eigenvalues' magnitudes over the root of their number, shape (s,).

    Parameters
    ----------
    values : float64, shape (s,)
        Eigenvalues over the number of samples, or of the integral operator: those of a Gaussian affinity sum
        to at most 1, so shapes with different numbers of samples are comparable.
    """
    return np.asarray(np.log(np.maximum(np.abs(values), 1e-6)) / np.sqrt(max(1, len(values))))


def laplacian_signature(values: Floats, area: float) -> Floats:
    """Return the logarithms of eigenvalues times the area, over the root of their number, shape (s,).

    This is ShapeDNA (Reuter, Wolter, Peinecke 2006), normalised by the area. Its authors divide by the first
    eigenvalue, which a thin neck or a loose component changes most. The Euclidean distance of two signatures
    is the root mean square difference of logarithms, for any s.

    Parameters
    ----------
    values : float64, shape (s,)
        Eigenvalues after the constant one, ascending.
    area : float
        Surface area, > 0.
    """
    return np.asarray(np.log(np.maximum(values * area, FAINTEST)) / np.sqrt(max(1, len(values))))
