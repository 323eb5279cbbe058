"""Local density: the distance of a shape to its nearest neighbours among the stored shapes.

A shape that is near to everything is a hub: it is the first answer to many queries, mostly wrongly. Local
scaling divides a distance by the root of the product of both shapes' distances to their seventh neighbours
(L. Zelnik-Manor, P. Perona, "Self-tuning spectral clustering", NIPS 2004); D. Schnitzer et al., "Local and
global scaling reduce hubs in space", JMLR 13, 2012.
"""

from dataclasses import dataclass

import numpy as np

from core.arrays import Floats

NEIGHBOUR = 7
"""The neighbour whose distance measures the density."""

TYPICAL_SPECTRAL, TYPICAL_VIEW = 0.14, 0.76
"""Distances to the seventh neighbour, the mean of the medians of the collections of the calibration."""

ENOUGH = 100
"""Number of shapes from which their distances alone tell the density."""


@dataclass(frozen=True, eq=False)
class LocalDensities:
    """Distances of shapes to their seventh neighbours among the stored shapes.

    Attributes
    ----------
    spectral, view : float64, shape (c,)
        By eigenvalues, and by views, > 0.
    """

    spectral: Floats
    view: Floats


def typical_densities(count: int) -> LocalDensities:
    """The densities of `count` shapes where no stored shapes are known."""
    return LocalDensities(np.full(count, TYPICAL_SPECTRAL), np.full(count, TYPICAL_VIEW))


def neighbour_distances(distances: Floats, typical: float) -> Floats:
    """The distance of each of c shapes to its seventh neighbour among n others, shape (c,).

    With n below `ENOUGH`, the result is the geometric mean of the typical distance and of that to the seventh
    neighbour, or to the last one of fewer; the weight of the latter is n / `ENOUGH`.

    Parameters
    ----------
    distances : float64, shape (c, m)
        Distances to the m shapes of a sample, >= 0; inf between a shape and itself.
    typical : float
        `TYPICAL_SPECTRAL` or `TYPICAL_VIEW`.
    """
    others = np.isfinite(distances).sum(axis=1)
    if not distances.shape[1]:
        return np.full(len(distances), typical)
    nearest = np.sort(np.partition(distances, min(NEIGHBOUR, distances.shape[1]) - 1)[:, :NEIGHBOUR])
    last = np.clip(others, 1, NEIGHBOUR) - 1
    found = nearest[np.arange(len(distances)), last]
    weight = np.minimum(others / ENOUGH, 1.0)
    known = np.where(others > 0, np.maximum(found, 1e-6), typical)
    return np.asarray(known**weight * typical ** (1.0 - weight))
