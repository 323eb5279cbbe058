"""Poisson-disk sampling by dart throwing: a maximal set of samples at least a radius apart."""

import numpy as np

from core.arrays import Floats, Ints
from core.errors import ParameterError

_HALVINGS = 40
"""Number of bisection steps for the radius."""


def poisson_disk(distances: Floats, radius: float, order: Ints) -> Ints:
    """Return a maximal set of points at least `radius` apart, by dart throwing (Cook 1986).

    Darts are tried in the given order; a dart nearer than the radius to an earlier sample is rejected. On a
    mesh the darts are its vertices and the distances are geodesic.

    Parameters
    ----------
    distances : float64, shape (n, n)
        Distances between all points, symmetric, zero on the diagonal.
    radius : float
        In the unit of the distances, >= 0; 0 selects every point.
    order : int64, shape (n,)
        A permutation of the points. It should be shuffled, else the set follows the pattern of the list.

    Returns
    -------
    int64, shape (m,)
        Samples in the order of the darts.
    """
    free = np.ones(len(distances), dtype=bool)
    samples = []
    for dart in order.tolist():
        if free[dart]:
            samples.append(dart)
            free &= distances[dart] >= radius
    return np.array(samples, dtype=np.int64)


def poisson_disk_of(distances: Floats, count: int, order: Ints) -> tuple[Ints, float]:
    """Return a Poisson-disk set of exactly `count` points, and its radius, found by bisection.

    If no radius gives the exact number, the last few samples are dropped: the samples stay a radius apart,
    and the set is not quite maximal. Parameters as in `poisson_disk`.

    Raises
    ------
    ParameterError
        The count is below 1 or above n.
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
