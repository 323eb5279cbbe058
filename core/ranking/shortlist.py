"""The shortlist: distances between signatures, and the candidates of least distance."""

import math

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats
from core.descriptors.facts import GLOBAL_DESCRIPTORS, GLOBAL_WEIGHT
from core.numerics.compilation import compiled_sum


def signature_distances(query: Float32s, signatures: Float32s) -> Floats:
    """Compute Euclidean distances from one signature, shape (s,), to each of n others, shape (n,), >= 0."""
    distances = np.empty(len(signatures))
    if len(signatures):
        _distances(np.array(query), np.require(signatures, requirements=["C", "W"]), distances)
    return distances


@compiled_sum
def _distances(query: Float32s, signatures: Float32s, distances: Floats) -> None:
    """Fill `distances`, shape (n,), by sums of float64."""
    for i in range(len(signatures)):
        total = 0.0
        for j in range(len(query)):
            difference = np.float64(signatures[i, j]) - np.float64(query[j])
            total += difference * difference
        distances[i] = math.sqrt(total)


def least(values: NDArray[np.floating], order: NDArray[np.integer], count: int) -> NDArray[np.intp]:
    """Return indices of the `count` least values, ascending; `order` breaks ties. Shape (min(count, n),)."""
    if count >= len(values):
        return np.lexsort((order, values))
    # The values below the last chosen one, and of equal ones the first in order.
    last = np.partition(values, count - 1)[count - 1]
    below = np.flatnonzero(values < last)
    equal = np.flatnonzero(values == last)
    equal = equal[np.argsort(order[equal], kind="stable")][: count - len(below)]
    chosen = np.concatenate([below, equal])
    return chosen[np.lexsort((order[chosen], values[chosen]))]


def spectral_distances(query: Float32s, signatures: Float32s) -> Floats:
    """Compute distances between the log eigenvalues of one signature and of c others, shape (c,), >= 0.

    Their last values are global descriptors, which do not count here.
    """
    return np.asarray(np.linalg.norm(eigenvalue_steps(query, signatures), axis=1))


def eigenvalue_steps(query: Float32s, signatures: Float32s) -> Floats:
    """Return the differences of the k log eigenvalues of c signatures from a query's, shape (c, k).

    Each is divided by the root of k, so that the norm of a row is a root mean square.
    """
    values = len(query) - GLOBAL_DESCRIPTORS
    return signatures[:, :values].astype(np.float64) - query[:values]


def global_distances(query: Float32s, signatures: Float32s) -> Floats:
    """Compute distances between the global descriptors of one signature and of c others, shape (c,).

    Global descriptors, times `GLOBAL_WEIGHT`, are the last values of a signature.
    """
    steps = signatures[:, -GLOBAL_DESCRIPTORS:].astype(np.float64) - query[-GLOBAL_DESCRIPTORS:]
    return np.asarray(np.linalg.norm(steps, axis=1) / GLOBAL_WEIGHT)
