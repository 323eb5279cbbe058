"""The shortlist: distances between signatures, and the candidates of least distance."""

import math

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats
from core.numerics.compilation import compiled


def signature_distances(query: Float32s, signatures: Float32s) -> Floats:
    """Euclidean distances from one signature to each of n others, shape (n,), >= 0.

    Parameters
    ----------
    query : float32, shape (s,)
    signatures : float32, shape (n, s)
    """
    distances = np.empty(len(signatures))
    if len(signatures):
        _distances(np.array(query), np.require(signatures, requirements=["C", "W"]), distances)
    return distances


@compiled
def _distances(query: Float32s, signatures: Float32s, distances: Floats) -> None:
    """Fill `distances`, shape (n,); four float64 sums run side by side to hide the latency of an addition."""
    n, s = signatures.shape
    whole = s - s % 4
    for i in range(n):
        a = b = c = d = 0.0
        for j in range(0, whole, 4):
            a += (np.float64(signatures[i, j]) - np.float64(query[j])) ** 2
            b += (np.float64(signatures[i, j + 1]) - np.float64(query[j + 1])) ** 2
            c += (np.float64(signatures[i, j + 2]) - np.float64(query[j + 2])) ** 2
            d += (np.float64(signatures[i, j + 3]) - np.float64(query[j + 3])) ** 2
        for j in range(whole, s):
            a += (np.float64(signatures[i, j]) - np.float64(query[j])) ** 2
        distances[i] = math.sqrt((a + b) + (c + d))


def least(values: NDArray[np.floating], order: NDArray[np.integer], count: int) -> NDArray[np.intp]:
    """Indices of the `count` least values, ascending; `order` breaks ties. Shape (min(count, n),).

    Parameters
    ----------
    values : float, shape (n,)
    order : int, shape (n,)
    count : int
        At least 1.
    """
    if count >= len(values):
        return np.lexsort((order, values))
    last = np.partition(values, count - 1)[count - 1]
    below = np.flatnonzero(values < last)
    equal = np.flatnonzero(values == last)
    equal = equal[np.argsort(order[equal], kind="stable")][: count - len(below)]
    found = np.concatenate([below, equal])
    return found[np.lexsort((order[found], values[found]))]
