"""Nearest neighbours between two clouds, and the cross-covariance of their pairs."""

import numpy as np

from core.arrays import Float32s, Int32s
from core.matching.kernels.simd import cross_product, product, squared_distance
from core.numerics.compilation import kernel

OFFSET = np.float32(1e-3)
"""Added to squared distances: rounding could make them negative, and their bits are compared as integers."""

FAR = np.int32(2**31 - 1)


@kernel
def number_bits(n: int) -> int:
    """Return a power of two above n, at least 128: so many of a distance's last values hold a number."""
    limit = 128
    while limit <= n:
        limit *= 2
    return limit


@kernel
def nearest_both_ways(
    rotated: Float32s, targets: Float32s, limit: int, forward: Int32s, backward: Int32s
) -> None:
    """Write the nearest target to each rotated point, and the nearest rotated point to each target.

    Squared distances are compared as integers, whose last bits hold the number of the point or target: the
    minimum brings its number along, in a SIMD loop.

    Parameters
    ----------
    rotated : float32, shape (m, k)
    targets : float32, shape (k, n)
        By columns: row c holds coordinate c of all.
    limit : int
        2^b > m, n, from `number_bits`: the b last bits of a distance hold a number.
    forward : int32, shape (m,)
        Written.
    backward : int32, shape (n,)
        Written.
    """
    m, k = rotated.shape
    n = targets.shape[1]
    # All products of points and targets, and the squared lengths of the targets.
    products = np.empty((m, n), dtype=np.float32)
    product(rotated, targets, products)
    lengths = np.zeros(n, dtype=np.float32)
    for c in range(k):
        for j in range(n):
            lengths[j] += targets[c, j] * targets[c, j]
    # Squared distances of a point, and their bits; masks of a distance and of a number.
    squares = np.empty(n, dtype=np.float32)
    bits = squares.view(np.int32)
    high = np.int32(-limit)
    last = np.int32(limit - 1)
    nought = np.float32(0.0)
    for j in range(n):
        backward[j] = FAR
    for i in range(m):
        # |x - y|^2 = |x|^2 + |y|^2 - 2 x y to all targets.
        length = OFFSET + squared_length(rotated, i)
        for j in range(n):
            squares[j] = max(length + lengths[j] - np.float32(2.0) * products[i, j], nought)
        # The minimum over targets, and that of each target so far.
        least = FAR
        number = np.int32(i)
        for j in range(n):
            key = np.int32(bits[j] & high)
            least = min(least, np.int32(key | np.int32(j)))
            backward[j] = min(backward[j], np.int32(key | number))
        forward[i] = least & last
    # The numbers alone.
    for j in range(n):
        backward[j] &= last


@kernel
def squared_length(points: Float32s, row: int) -> np.float32:
    """Return the squared length of a row, in four sums: one would wait for itself at each step."""
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
def nearest_columns(points: Float32s, targets: Float32s, k: int, limit: int, nearest: Int32s) -> None:
    """Write the nearest of n targets to each of p points, both held by columns, in their first k dimensions.

    Squared distances are compared in their leading bits; among equals the first target wins.

    Parameters
    ----------
    points : float32, shape (>= k, p)
    targets : float32, shape (>= k, n)
    k : int
    limit : int
        2^b > n, at most 2^14: the b last of a distance's 23 bits hold the target's number.
    nearest : int32, shape (p,)
        Written.
    """
    # Squared distances, and their bits as integers that sort alike.
    p = points.shape[1]
    squares = np.empty(p, dtype=np.float32)
    bits = squares.view(np.int32)
    high = np.int32(-limit)
    for i in range(p):
        nearest[i] = FAR
    for j in range(targets.shape[1]):
        # Squared distances of all points to one target.
        y = targets[0, j]
        for i in range(p):
            squares[i] = (points[0, i] - y) * (points[0, i] - y)
        for c in range(1, k):
            y = targets[c, j]
            for i in range(p):
                squares[i] += (points[c, i] - y) * (points[c, i] - y)
        # Its number in their last bits: the minimum brings it along.
        number = np.int32(j)
        for i in range(p):
            nearest[i] = min(nearest[i], np.int32(np.int32(bits[i] & high) | number))
    # The numbers alone.
    last = np.int32(limit - 1)
    for i in range(p):
        nearest[i] &= last


@kernel
def nearest_member(points: Float32s, members: Int32s, start: int, stop: int, ends: Float32s, end: int) -> int:
    """Return the one of the rows members[start:stop] of points that is nearest to row `end` of ends."""
    least = np.float32(3e38)
    nearest = members[start]
    for position in range(start, stop):
        row = members[position]
        distance = squared_distance(points, row, ends, end)
        if distance < least:
            least = distance
            nearest = row
    return int(nearest)


@kernel
def gather(points: Float32s, rows: Int32s, gathered: Float32s) -> None:
    """Write gathered = points[rows], number by number: assigned rows cost a function call each."""
    for i in range(len(rows)):
        for c in range(points.shape[1]):
            gathered[i, c] = points[rows[i], c]


@kernel
def centred_squares(
    sums: Float32s, squares: Float32s, share: np.float32, first: Float32s, second: Float32s
) -> None:
    """Write the centred square sums of both sides of pairs, over each of b blocks of columns.

    Parameters
    ----------
    sums, squares : float32, shape (2, b k)
        Sums of the coordinates of both sides, and of their squares.
    share : float32
        1 / the number of pairs.
    first, second : float32, shape (b,)
        Written.
    """
    blocks = len(first)
    k = sums.shape[1] // blocks
    for block in range(blocks):
        square_of_x = np.float32(0.0)
        square_of_y = np.float32(0.0)
        for c in range(block * k, block * k + k):
            square_of_x += squares[0, c] - sums[0, c] * sums[0, c] * share
            square_of_y += squares[1, c] - sums[1, c] * sums[1, c] * share
        first[block] = square_of_x
        second[block] = square_of_y


@kernel
def cross_covariance_both_ways(
    x: Float32s,
    y: Float32s,
    forward: Int32s,
    backward: Int32s,
    covariance: Float32s,
    first: Float32s,
    second: Float32s,
) -> None:
    """Write `cross_covariance` of x with y[forward] and of x[backward] with y.

    The points of x that are paired with one point of y are added up, so that one product serves both ways.

    Parameters
    ----------
    x : float32, shape (m, b k)
    y : float32, shape (n, b k)
    forward : int32, shape (m,)
    backward : int32, shape (n,)
    covariance : float32, shape (b k, b k)
        Written.
    first, second : float32, shape (b,)
        Written.
    """
    m, columns = x.shape
    n = len(y)
    share = np.float32(1.0) / np.float32(m + n)
    # For each point of y the sum of its partners; for each point the number of pairs it is in.
    gathered = np.empty((n, columns), dtype=np.float32)
    counts_of_y = np.ones(n, dtype=np.float32)
    counts_of_x = np.ones(m, dtype=np.float32)
    for j in range(n):
        counts_of_x[backward[j]] += np.float32(1.0)
        for c in range(columns):
            gathered[j, c] = x[backward[j], c]
    for i in range(m):
        j = forward[i]
        counts_of_y[j] += np.float32(1.0)
        for c in range(columns):
            gathered[j, c] += x[i, c]
    # Sums and square sums of both sides, each point as often as it is paired.
    sums = np.zeros((2, columns), dtype=np.float32)
    squares = np.zeros((2, columns), dtype=np.float32)
    for i in range(m):
        weight = counts_of_x[i]
        for c in range(columns):
            weighted = weight * x[i, c]
            sums[0, c] += weighted
            squares[0, c] += weighted * x[i, c]
    for j in range(n):
        weight = counts_of_y[j]
        for c in range(columns):
            weighted = weight * y[j, c]
            sums[1, c] += weighted
            squares[1, c] += weighted * y[j, c]
    centred_squares(sums, squares, share, first, second)
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
    covariance : float32, shape (b k, b k)
        Written.
    first, second : float32, shape (b,)
        Written: square sums over each block of columns, of points and sources and of partners and targets.
    """
    columns = points.shape[1]
    # Sums and square sums of both sides.
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
    centred_squares(sums, squares, share, first, second)
    # Products of both sets, less that of the means.
    forward = np.zeros((columns, columns), dtype=np.float32)
    backward = np.zeros((columns, columns), dtype=np.float32)
    if len(points) > 0:
        cross_product(points, partners, forward)
    if len(sources) > 0:
        cross_product(sources, targets, backward)
    for c in range(columns):
        mean = sums[0, c] * share
        for d in range(columns):
            covariance[c, d] = forward[c, d] + backward[c, d] - mean * sums[1, d]
