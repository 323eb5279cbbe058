"""Nearest neighbours both ways between two clouds, and the cross-covariance of their pairs."""

import numpy as np

from core.arrays import Float32s, Floats, Int32s, Ints
from core.matching.kernels.matrix_product import cross_product, product
from core.matching.kernels.spline_search import FAR
from core.matching.kernels.squared_distance import squared_distance
from core.numerics.compilation import kernel

OFFSET = np.float32(1e-3)
"""Added to squared distances: rounding could make them negative, and their bits are compared as integers."""


@kernel
def nearest_both_ways(rotated: Float32s, targets: Float32s, low: int, there: Int32s, back: Int32s) -> None:
    """Write the nearest target to each rotated point, and the nearest rotated point to each target.

    Parameters
    ----------
    rotated : float32, shape (m, k)
    targets : float32, shape (k, n)
        By columns: row c holds coordinate c of all.
    low : int
        2^b > m, n: the b last bits of a distance hold a number, as in `core.matching.kernels.spline_search`.
    there : int32, shape (m,)
    back : int32, shape (n,)
    """
    m, k = rotated.shape
    n = targets.shape[1]
    products = np.empty((m, n), dtype=np.float32)
    product(rotated, targets, products)
    lengths = np.zeros(n, dtype=np.float32)
    for c in range(k):
        for j in range(n):
            lengths[j] += targets[c, j] * targets[c, j]
    squares = np.empty(n, dtype=np.float32)
    bits = squares.view(np.int32)
    high = np.int32(-low)
    last = np.int32(low - 1)
    nought = np.float32(0.0)
    for j in range(n):
        back[j] = FAR
    for i in range(m):
        own = OFFSET + square(rotated, i)
        for j in range(n):
            squares[j] = max(own + lengths[j] - np.float32(2.0) * products[i, j], nought)
        least = FAR
        number = np.int32(i)
        for j in range(n):
            key = np.int32(bits[j] & high)
            least = min(least, np.int32(key | np.int32(j)))
            back[j] = min(back[j], np.int32(key | number))
        there[i] = least & last
    for j in range(n):
        back[j] &= last


@kernel
def square(points: Float32s, row: int) -> np.float32:
    """Squared length of a row, in four sums: one would wait for itself at each step."""
    k = points.shape[1]
    whole = k - k % 4
    a = b = c = d = np.float32(0.0)
    for i in range(0, whole, 4):
        a += points[row, i] * points[row, i]
        b += points[row, i + 1] * points[row, i + 1]
        c += points[row, i + 2] * points[row, i + 2]
        d += points[row, i + 3] * points[row, i + 3]
    for i in range(whole, k):
        a += points[row, i] * points[row, i]
    return (a + b) + (c + d)


@kernel
def closest(points: Float32s, members: Int32s, start: int, stop: int, ends: Float32s, end: int) -> int:
    """The one of the rows members[start:stop] of points that is closest to row `end` of ends."""
    least = np.float32(3e38)
    found = members[start]
    for place in range(start, stop):
        row = members[place]
        distance = squared_distance(points, row, ends, end)
        if distance < least:
            least = distance
            found = row
    return int(found)


@kernel
def gather(points: Float32s, rows: Int32s, found: Float32s) -> None:
    """Write found = points[rows], by numbers: the compiler calls a function for each row that is assigned."""
    for i in range(len(rows)):
        for c in range(points.shape[1]):
            found[i, c] = points[rows[i], c]


@kernel
def cross_covariance_both_ways(
    x: Float32s,
    y: Float32s,
    there: Int32s,
    back: Int32s,
    blocks: int,
    covariance: Float32s,
    first: Float32s,
    second: Float32s,
) -> None:
    """`cross_covariance` of x with y[there] and of x[back] with y.

    The points of x that are paired with one point of y are added up, so that one product serves both ways.

    Parameters
    ----------
    x : float32, shape (m, b k)
    y : float32, shape (n, b k)
    there : int32, shape (m,)
    back : int32, shape (n,)
    """
    m, columns = x.shape
    n = len(y)
    k = columns // blocks
    share = np.float32(1.0) / np.float32(m + n)
    gathered = np.empty((n, columns), dtype=np.float32)
    counts = np.ones(n, dtype=np.float32)
    times = np.ones(m, dtype=np.float32)
    for j in range(n):
        times[back[j]] += np.float32(1.0)
        for c in range(columns):
            gathered[j, c] = x[back[j], c]
    for i in range(m):
        j = there[i]
        counts[j] += np.float32(1.0)
        for c in range(columns):
            gathered[j, c] += x[i, c]
    sums = np.zeros((2, columns), dtype=np.float32)
    squares = np.zeros((2, columns), dtype=np.float32)
    for i in range(m):
        weight = times[i]
        for c in range(columns):
            weighed = weight * x[i, c]
            sums[0, c] += weighed
            squares[0, c] += weighed * x[i, c]
    for j in range(n):
        weight = counts[j]
        for c in range(columns):
            weighed = weight * y[j, c]
            sums[1, c] += weighed
            squares[1, c] += weighed * y[j, c]
    for block in range(blocks):
        one = np.float32(0.0)
        other = np.float32(0.0)
        for c in range(block * k, block * k + k):
            one += squares[0, c] - sums[0, c] * sums[0, c] * share
            other += squares[1, c] - sums[1, c] * sums[1, c] * share
        first[block] = one
        second[block] = other
    products = np.empty((columns, columns), dtype=np.float32)
    cross_product(gathered, y, products)
    for c in range(columns):
        mean = sums[0, c] * share
        for d in range(columns):
            covariance[c, d] = products[c, d] - mean * sums[1, d]


@kernel
def cross_covariance(
    points: Float32s,
    partners: Float32s,
    sources: Float32s,
    targets: Float32s,
    blocks: int,
    covariance: Float32s,
    first: Float32s,
    second: Float32s,
) -> None:
    """Write the cross-covariance and the centred square sums of two sets of pairs.

    Points are paired with partners, sources with targets. The sums are not divided by the number of pairs.

    Parameters
    ----------
    points, partners : float32, shape (m, b k)
    sources, targets : float32, shape (n, b k)
    blocks : int
        b.
    covariance : float32, shape (b k, b k)
        Written.
    first, second : float32, shape (b,)
        Written: square sums over each block of columns of one side and of the other.
    """
    columns = points.shape[1]
    k = columns // blocks
    sums = np.zeros((2, columns), dtype=np.float32)
    squares = np.zeros((2, columns), dtype=np.float32)
    for i in range(len(points)):
        for c in range(columns):
            sums[0, c] += points[i, c]
            sums[1, c] += partners[i, c]
            squares[0, c] += points[i, c] * points[i, c]
            squares[1, c] += partners[i, c] * partners[i, c]
    for i in range(len(sources)):
        for c in range(columns):
            sums[0, c] += sources[i, c]
            sums[1, c] += targets[i, c]
            squares[0, c] += sources[i, c] * sources[i, c]
            squares[1, c] += targets[i, c] * targets[i, c]
    share = np.float32(1.0) / np.float32(len(points) + len(sources))
    for block in range(blocks):
        one = np.float32(0.0)
        other = np.float32(0.0)
        for c in range(block * k, block * k + k):
            one += squares[0, c] - sums[0, c] * sums[0, c] * share
            other += squares[1, c] - sums[1, c] * sums[1, c] * share
        first[block] = one
        second[block] = other
    there = np.zeros((columns, columns), dtype=np.float32)
    back = np.zeros((columns, columns), dtype=np.float32)
    if len(points) > 0:
        cross_product(points, partners, there)
    if len(sources) > 0:
        cross_product(sources, targets, back)
    for c in range(columns):
        mean = sums[0, c] * share
        for d in range(columns):
            covariance[c, d] = there[c, d] + back[c, d] - mean * sums[1, d]


def nearest_both_ways_reference(rotated: Floats, targets: Floats) -> tuple[Ints, Ints]:
    """The plain form of `nearest_both_ways`, with exact squared distances."""
    squares = ((rotated[:, None, :] - targets[None, :, :]) ** 2).sum(axis=2)
    return np.asarray(squares.argmin(axis=1)), np.asarray(squares.argmin(axis=0))
