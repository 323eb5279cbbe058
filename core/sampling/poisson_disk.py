"""Poisson-disk selection by dart throwing: no two samples nearer than a radius, and no room for one more."""

import numpy as np

from core.arrays import Floats, Ints
from core.errors import ParameterError

_HALVINGS = 40
"""Of the interval that holds the radius, to which the number of samples answers in steps."""


def poisson_disk(distances: Floats, radius: float, order: Ints) -> Ints:
    """A maximal set of points at least `radius` apart: every point is in it or nearer than that to one in it.

    Darts are thrown in the order given and each that falls too near an earlier one is lost (Cook 1986). On a
    mesh the darts are its vertices and distances are geodesic.

    Parameters
    ----------
    distances : float64, shape (n, n)
        Between all points, symmetric, zero on the diagonal.
    radius : float
        In the unit of the distances, not negative; 0 takes every point.
    order : int64, shape (n,)
        Each point once; shuffled, or the set follows the list's own pattern.

    Returns
    -------
    int64, shape (m,)
        In the order of their throws.
    """
    free = np.ones(len(distances), dtype=bool)
    samples = []
    for dart in order.tolist():
        if free[dart]:
            samples.append(dart)
            free &= distances[dart] >= radius
    return np.array(samples, dtype=np.int64)


def poisson_disk_of(distances: Floats, count: int, order: Ints) -> tuple[Ints, float]:
    """A Poisson-disk set of exactly `count` points, and its radius.

    The radius is found by halving. The size of a set goes in steps, so the last few points thrown are left
    out where no radius gives the number: the set keeps its radius, and just misses being maximal.

    Raises
    ------
    ParameterError
        A count under 1 or over n.
    """
    if not 1 <= count <= len(distances):
        raise ParameterError(f"a set of {count} cannot be taken from {len(distances)} points")
    low, high = 0.0, 2.0 * float(distances.max())
    samples = order
    for _ in range(_HALVINGS):
        radius = 0.5 * (low + high)
        found = poisson_disk(distances, radius, order)
        if len(found) < count:
            high = radius
        else:
            low, samples = radius, found
        if len(found) == count:
            break
    return samples[:count].astype(np.int64), low
