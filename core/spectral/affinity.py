"""Affinity matrices of the samples, from their distances (section 3.3, Eq. 13)."""

import numpy as np

from core.arrays import Floats
from core.errors import ParameterError


def gaussian_affinity(distances: Floats, width: float, areas: Floats | None = None) -> Floats:
    """Return the Gaussian affinity W = exp(-d^2 / 2 s^2), in [0, 1]; s is `width` times the mean distance.

    Parameters
    ----------
    distances : float64, shape (m, m), or (d, m) with areas
        >= 0.
    width : float
        > 0.
    areas : float64, shape (m,), optional
        Weights of the columns in the mean, of sum 1. Without them the mean is over pairs of distinct samples.

    Returns
    -------
    float64, of the shape of `distances`

    Raises
    ------
    ParameterError
        The width is not positive.
    """
    if not width > 0.0:
        raise ParameterError(f"the affinity's width must be positive, not {width}")
    count = len(distances)
    mean = (
        float(distances.sum()) / (count * (count - 1)) if areas is None else float((distances @ areas).mean())
    )
    return np.asarray(np.exp(-(distances**2) / (2.0 * (width * mean) ** 2)))


def distance_affinity(distances: Floats) -> Floats:
    """Return the literal Eq. 13: distances over their mean off the diagonal, and 1 on it, shape (m, m).

    Parameters
    ----------
    distances : float64, shape (m, m)
        Symmetric, 0 on the diagonal.
    """
    count = len(distances)
    mean = float(distances.sum()) / (count * (count - 1))
    affinity = distances / mean
    np.fill_diagonal(affinity, 1.0)
    return affinity
