"""Affinity of the samples, its eigenvectors, and the k-dimensional embedding (section 3.3)."""

import numpy as np

from core.arrays import Floats
from core.errors import ParameterError


def gaussian_affinity(distances: Floats, width: float, areas: Floats | None = None) -> Floats:
    """W = exp(-d^2 / 2 s^2), s = `width` times the mean distance; ones where the distance is 0.

    Parameters
    ----------
    distances : float64, shape (m, m), or (d, m) with areas
    width : float
    areas : float64, shape (m,), optional
        Shares that weigh the columns in the mean; without them it is that of distinct samples.

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
    """The literal Eq. 13: distances over their mean off the diagonal, ones on it, shape (m, m)."""
    count = len(distances)
    mean = float(distances.sum()) / (count * (count - 1))
    affinity = distances / mean
    np.fill_diagonal(affinity, 1.0)
    return affinity
