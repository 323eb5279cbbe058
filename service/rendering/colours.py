"""Colours by position, which show the correspondence of two shapes."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from core.arrays import Floats

_NEIGHBOURS = 3


def colours_of_points(points: Floats, format_up: Floats) -> Floats:
    """Colours of p points by position: red, green and blue increase along x, y and z, in [0.1, 1].

    Parameters
    ----------
    points : float64, shape (p, 3)
    format_up : float64, shape (3, 3)
        The rotation after which y is up.
    """
    rotated = points @ format_up.T
    low, high = rotated.min(axis=0), rotated.max(axis=0)
    extent = np.where(high > low, high - low, 1.0)
    return np.asarray(0.1 + 0.9 * (rotated - low) / extent)


def interpolate_colours(points: Floats, colours: Floats, vertices: Floats) -> NDArray[np.uint8]:
    """Colours of n vertices: means of the three nearest points, weighted by inverse squared distance.

    Returns
    -------
    uint8, shape (n, 4)
        Red, green, blue and opacity 255.
    """
    distances, near = KDTree(points).query(vertices, k=min(_NEIGHBOURS, len(points)))
    distances, near = distances.reshape(len(vertices), -1), near.reshape(len(vertices), -1)
    weights = 1.0 / np.maximum(distances, 1e-9 * max(float(distances.max()), 1e-300)) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    mixed = np.einsum("nk,nkc->nc", weights, colours[near])
    opaque = np.ones((len(vertices), 1))
    return np.asarray(np.rint(255.0 * np.clip(np.hstack([mixed, opaque]), 0.0, 1.0)), dtype=np.uint8)
