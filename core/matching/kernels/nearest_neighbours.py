"""Nearest neighbours between two clouds, and the cross-covariance of their pairs.

Clouds are held by rows or by columns. Rows are padded to whole vectors: of shape (m, b w), they have k
coordinates of each of b domains, and w - k numbers that no distance depends on.
"""

import numpy as np

from core.arrays import Float32s, Int32s
from core.matching.kernels.simd import (
    SIMD_WIDTH,
    SUMS,
    TILE_ROWS,
    Vector,
    bits,
    entry,
    fused,
    greatest,
    lane,
    least,
    load,
    repeat,
    squared_distance,
    store,
    tile,
    tile_rows,
    whole_vectors,
)
from core.numerics.compilation import inlined, kernel

OFFSET = np.float32(1e-3)
"""Added to squared distances: rounding could make them negative, and their bits are compared as integers."""

FAR = np.int32(2**31 - 1)


@inlined
def padded_width(k: int) -> int:
    """Return the width w of a domain of k dimensions in rows of whole vectors, above k."""
    return whole_vectors(k + 1)


@kernel
def padded_rows(points: Float32s, count: int, domains: int) -> Float32s:
    """Return the first rows of points, shape (d, b k), with each domain padded, shape (count, b w)."""
    k = points.shape[1] // domains
    rows = np.empty((count, domains * padded_width(k)), dtype=np.float32)
    for i in range(count):
        copy_padded(points, i, rows, i, domains, k)
    return rows


@inlined
def copy_padded(points: Float32s, row: int, rows: Float32s, place: int, domains: int, k: int) -> None:
    """Write a row of points, shape (d, b k), to a row of padded ones, shape (m, b w)."""
    width = padded_width(k)
    for domain in range(domains):
        _copy_vectors(
            points, (row * domains + domain) * k, k, width, rows, (place * domains + domain) * width
        )


@inlined
def _copy_vectors(numbers: Float32s, start: int, k: int, width: int, out: Float32s, place: int) -> None:
    """Write k numbers of an array, and others up to whole vectors: those that follow, if there are any."""
    if start + width <= numbers.size:
        for c in range(0, width, SIMD_WIDTH):
            store(load(numbers, start + c, SIMD_WIDTH), out, place + c)
    else:
        for c in range(0, width, SIMD_WIDTH):
            store(repeat(np.float32(0.0), SIMD_WIDTH), out, place + c)
        for c in range(k):
            store(entry(numbers, start + c, 1), out, place + c)


@kernel
def columns_of(points: Float32s, count: int) -> Float32s:
    """Return the first rows of points, shape (d, k), by columns, padded by zeros to whole vectors."""
    k = points.shape[1]
    columns = np.zeros((k, whole_vectors(count)), dtype=np.float32)
    for i in range(count):
        for c in range(k):
            columns[c, i] = points[i, c]
    return columns


@kernel
def mapped(rows: Float32s, rotation: Float32s, domains: int) -> Float32s:
    """Return points times a map, a domain at a time: shape (m, b w), as the points.

    Parameters
    ----------
    rows : float32, shape (m, b w)
    rotation : float32, shape (b k, b k)
        Zeros outside of the blocks.
    domains : int
        b.
    """
    m, columns = rows.shape
    width = columns // domains
    k = len(rotation) // domains
    out = np.empty((m, columns), dtype=np.float32)
    block = np.empty((k, width), dtype=np.float32)
    for domain in range(domains):
        low = domain * width
        for i in range(k):
            _copy_vectors(rotation, (domain * k + i) * len(rotation) + domain * k, k, width, block, i * width)
        for i in range(0, m, TILE_ROWS):
            places = tile_rows(i, m, columns)
            begins = (places[0] + low, places[1] + low, places[2] + low, places[3] + low)
            for j in range(0, width, SIMD_WIDTH):
                first, second, third, fourth = tile(rows, begins, 1, block, j, width, k)
                store(first, out, begins[0] + j)
                store(second, out, begins[1] + j)
                store(third, out, begins[2] + j)
                store(fourth, out, begins[3] + j)
    return out


@kernel
def compact_rows(rows: Float32s, domains: int, k: int) -> Float32s:
    """Return rows, shape (m, b w), without their padding, shape (m, b k)."""
    m, columns = rows.shape
    width = columns // domains
    # The padding of a row is overwritten by the next row, and that of the last is beyond the result.
    numbers = np.empty(m * domains * k + width, dtype=np.float32)
    for i in range(m):
        for domain in range(domains):
            start, place = i * columns + domain * width, (i * domains + domain) * k
            for c in range(0, width, SIMD_WIDTH):
                store(load(rows, start + c, SIMD_WIDTH), numbers, place + c)
    return numbers[: m * domains * k].reshape(m, domains * k)


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
    minimum brings its number along. Distances of four points to a vector of targets stay in registers.

    Parameters
    ----------
    rotated : float32, shape (m, k)
    targets : float32, shape (k, at least n)
        By columns, of `columns_of`: row c holds coordinate c of all.
    limit : int
        2^b > m, n, from `number_bits`: the b last bits of a distance hold a number.
    forward : int32, shape (m,)
        Written.
    backward : int32, shape (n,)
        Written.
    """
    m, k = rotated.shape
    n, width = len(backward), targets.shape[1]
    # The squared lengths of the targets, and their numbers: that of padding is no number.
    lengths = np.empty(width, dtype=np.float32)
    numbers = np.full(width, FAR, dtype=np.int32)
    nearest = np.full(width, FAR, dtype=np.int32)
    nought = repeat(np.float32(0.0), SIMD_WIDTH)
    for j in range(0, width, SIMD_WIDTH):
        squares = nought
        for c in range(k):
            coordinates = load(targets, c * width + j, SIMD_WIDTH)
            squares = squares + coordinates * coordinates
        store(squares, lengths, j)
    for j in range(n):
        numbers[j] = j
    last = np.int32(limit - 1)
    high = repeat(np.int32(-limit), SIMD_WIDTH)
    minus_two = repeat(np.float32(-2.0), SIMD_WIDTH)
    far = repeat(FAR, SIMD_WIDTH)
    for i in range(0, m, TILE_ROWS):
        # Four points, the last one in the place of points beyond it.
        rows = tile_rows(i, m, 1)
        places = tile_rows(i, m, k)
        first_length = repeat(OFFSET + squared_length(rotated, rows[0]), SIMD_WIDTH)
        second_length = repeat(OFFSET + squared_length(rotated, rows[1]), SIMD_WIDTH)
        third_length = repeat(OFFSET + squared_length(rotated, rows[2]), SIMD_WIDTH)
        fourth_length = repeat(OFFSET + squared_length(rotated, rows[3]), SIMD_WIDTH)
        first_number = repeat(np.int32(rows[0]), SIMD_WIDTH)
        second_number = repeat(np.int32(rows[1]), SIMD_WIDTH)
        third_number = repeat(np.int32(rows[2]), SIMD_WIDTH)
        fourth_number = repeat(np.int32(rows[3]), SIMD_WIDTH)
        first_least, second_least, third_least, fourth_least = far, far, far, far
        for j in range(0, width, SIMD_WIDTH):
            first, second, third, fourth = tile(rotated, places, 1, targets, j, width, k)
            # |x - y|^2 = |x|^2 + |y|^2 - 2 x y, without the bits that hold a number.
            length, number = load(lengths, j, SIMD_WIDTH), load(numbers, j, SIMD_WIDTH)
            first_bits = bits(greatest(fused(minus_two, first, first_length + length), nought)) & high
            second_bits = bits(greatest(fused(minus_two, second, second_length + length), nought)) & high
            third_bits = bits(greatest(fused(minus_two, third, third_length + length), nought)) & high
            fourth_bits = bits(greatest(fused(minus_two, fourth, fourth_length + length), nought)) & high
            # The minimum of each point over targets, and that of each target so far.
            first_least = least(first_least, first_bits | number)
            second_least = least(second_least, second_bits | number)
            third_least = least(third_least, third_bits | number)
            fourth_least = least(fourth_least, fourth_bits | number)
            before = least(load(nearest, j, SIMD_WIDTH), first_bits | first_number)
            after = least(second_bits | second_number, third_bits | third_number)
            store(least(least(before, fourth_bits | fourth_number), after), nearest, j)
        forward[rows[0]] = least_lane(first_least) & last
        forward[rows[1]] = least_lane(second_least) & last
        forward[rows[2]] = least_lane(third_least) & last
        forward[rows[3]] = least_lane(fourth_least) & last
    # The numbers alone.
    for j in range(n):
        backward[j] = nearest[j] & last


@inlined
def least_lane(vector: Vector) -> np.int32:
    """Return the least number of a vector."""
    number = lane(vector, 0)
    for index in range(1, SIMD_WIDTH):
        number = min(number, lane(vector, index))
    return np.int32(number)


@inlined
def squared_length(points: Float32s, row: int) -> np.float32:
    """Return the squared length of a row, in four sums: one would wait for itself at each step."""
    k = points.shape[1]
    whole = k - k % SUMS
    sums = repeat(np.float32(0.0), SUMS)
    for c in range(0, whole, SUMS):
        numbers = load(points, row * k + c, SUMS)
        sums = sums + numbers * numbers
    first, second, third, fourth = lane(sums, 0), lane(sums, 1), lane(sums, 2), lane(sums, 3)
    for c in range(whole, k):
        first += points[row, c] * points[row, c]
    return np.float32((first + second) + (third + fourth))


@kernel
def nearest_columns(points: Float32s, targets: Float32s, k: int, limit: int, nearest: Int32s) -> None:
    """Write the nearest of n targets to each of p points, both held by columns, in their first k dimensions.

    Squared distances are compared in their leading bits; among equals the first target wins.

    Parameters
    ----------
    points : float32, shape (>= k, p)
        p is a multiple of SIMD_WIDTH.
    targets : float32, shape (>= k, n)
    k : int
    limit : int
        2^b > n, at most 2^14: the b last of a distance's 23 bits hold the target's number.
    nearest : int32, shape (p,)
        Written.
    """
    p, n = points.shape[1], targets.shape[1]
    high = repeat(np.int32(-limit), SIMD_WIDTH)
    last = repeat(np.int32(limit - 1), SIMD_WIDTH)
    for i in range(0, p, SIMD_WIDTH):
        # A vector of points; four targets at a time, the last one in the place of targets beyond it.
        keys = repeat(FAR, SIMD_WIDTH)
        for j in range(0, n, TILE_ROWS):
            numbers = tile_rows(j, n, 1)
            coordinates = load(points, i, SIMD_WIDTH)
            first = coordinates - entry(targets, numbers[0], SIMD_WIDTH)
            second = coordinates - entry(targets, numbers[1], SIMD_WIDTH)
            third = coordinates - entry(targets, numbers[2], SIMD_WIDTH)
            fourth = coordinates - entry(targets, numbers[3], SIMD_WIDTH)
            first, second, third, fourth = first * first, second * second, third * third, fourth * fourth
            for c in range(1, k):
                coordinates = load(points, c * p + i, SIMD_WIDTH)
                along = c * n
                step = coordinates - entry(targets, along + numbers[0], SIMD_WIDTH)
                first = first + step * step
                step = coordinates - entry(targets, along + numbers[1], SIMD_WIDTH)
                second = second + step * step
                step = coordinates - entry(targets, along + numbers[2], SIMD_WIDTH)
                third = third + step * step
                step = coordinates - entry(targets, along + numbers[3], SIMD_WIDTH)
                fourth = fourth + step * step
            # The targets' numbers in the last bits: the minimum brings them along.
            keys = least(keys, (bits(first) & high) | repeat(np.int32(numbers[0]), SIMD_WIDTH))
            keys = least(keys, (bits(second) & high) | repeat(np.int32(numbers[1]), SIMD_WIDTH))
            keys = least(keys, (bits(third) & high) | repeat(np.int32(numbers[2]), SIMD_WIDTH))
            keys = least(keys, (bits(fourth) & high) | repeat(np.int32(numbers[3]), SIMD_WIDTH))
        # The numbers alone.
        store(keys & last, nearest, i)


@inlined
def nearest_member(points: Float32s, members: Int32s, start: int, stop: int, ends: Float32s, end: int) -> int:
    """Return the one of the rows members[start:stop] of points that is nearest to row `end` of ends.

    A distance's bits stand before a position's: the minimum needs no branch, and the first of equals wins.
    """
    nearest = np.int64(2**63 - 1)
    for position in range(start, stop):
        distance = squared_distance(points, members[position], ends, end)
        key = np.int64(lane(bits(repeat(distance, SUMS)), 0)) << np.int64(32)
        nearest = min(nearest, key | np.int64(position))
    return int(members[nearest & 0xFFFFFFFF])


@kernel
def gather(rows: Float32s, numbers: Int32s, gathered: Float32s) -> None:
    """Write gathered = rows[numbers], of rows of whole vectors."""
    width = rows.shape[1]
    for i in range(len(numbers)):
        for c in range(0, width, SIMD_WIDTH):
            store(load(rows, numbers[i] * width + c, SIMD_WIDTH), gathered, i * width + c)


@kernel
def _add_moments(rows: Float32s, weights: Float32s, sums: Float32s, squares: Float32s) -> None:
    """Add weighted rows, shape (m, b w), and their weighted squares to sums, shape (b w,)."""
    m, width = rows.shape
    for c in range(0, width, SIMD_WIDTH):
        total, square = load(sums, c, SIMD_WIDTH), load(squares, c, SIMD_WIDTH)
        for i in range(m):
            numbers = load(rows, i * width + c, SIMD_WIDTH)
            weighted = entry(weights, i, SIMD_WIDTH) * numbers
            total = total + weighted
            square = square + weighted * numbers
        store(total, sums, c)
        store(square, squares, c)


@kernel
def _add_products(left: Float32s, right: Float32s, k: int, products: Float32s) -> None:
    """Add left.T @ right, of rows of shape (m, b w), of each domain to products, shape (b, w, w)."""
    m, columns = left.shape
    domains, width, _ = products.shape
    for domain in range(domains):
        for a in range(0, k, TILE_ROWS):
            low = domain * width
            rows = (low + a, low + a + 1, low + a + 2, low + a + 3)
            for c in range(0, width, SIMD_WIDTH):
                first, second, third, fourth = tile(left, rows, columns, right, low + c, columns, m)
                place = (low + a) * width + c
                store(load(products, place, SIMD_WIDTH) + first, products, place)
                place += width
                store(load(products, place, SIMD_WIDTH) + second, products, place)
                place += width
                store(load(products, place, SIMD_WIDTH) + third, products, place)
                place += width
                store(load(products, place, SIMD_WIDTH) + fourth, products, place)


@kernel
def _centred(
    sums: Float32s,
    squares: Float32s,
    products: Float32s,
    pairs: int,
    k: int,
    covariance: Float32s,
    first: Float32s,
    second: Float32s,
) -> None:
    """Write covariances and square sums about the means, of the sums over pairs and their products."""
    domains, width, _ = products.shape
    share = np.float32(1.0) / np.float32(pairs)
    for domain in range(domains):
        low = domain * width
        square_of_x = np.float32(0.0)
        square_of_y = np.float32(0.0)
        for c in range(low, low + k):
            square_of_x += squares[0, c] - sums[0, c] * sums[0, c] * share
            square_of_y += squares[1, c] - sums[1, c] * sums[1, c] * share
        first[domain] = square_of_x
        second[domain] = square_of_y
        for c in range(k):
            mean = sums[0, low + c] * share
            for d in range(k):
                covariance[domain, c, d] = products[domain, c, d] - mean * sums[1, low + d]


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
    x : float32, shape (m, b w)
    y : float32, shape (n, b w)
    forward : int32, shape (m,)
    backward : int32, shape (n,)
    covariance : float32, shape (b, k, k)
        Written.
    first, second : float32, shape (b,)
        Written.
    """
    m, columns = x.shape
    n = len(y)
    domains = len(first)
    # For each point of y the sum of its partners; for each point the number of pairs it is in.
    gathered = np.empty((n, columns), dtype=np.float32)
    gather(x, backward, gathered)
    counts_of_y = np.ones(n, dtype=np.float32)
    counts_of_x = np.ones(m, dtype=np.float32)
    for j in range(n):
        counts_of_x[backward[j]] += np.float32(1.0)
    for i in range(m):
        j = forward[i]
        counts_of_y[j] += np.float32(1.0)
        for c in range(0, columns, SIMD_WIDTH):
            place = j * columns + c
            store(load(gathered, place, SIMD_WIDTH) + load(x, i * columns + c, SIMD_WIDTH), gathered, place)
    # Sums and square sums of both sides, each point as often as it is paired.
    sums = np.zeros((2, columns), dtype=np.float32)
    squares = np.zeros((2, columns), dtype=np.float32)
    _add_moments(x, counts_of_x, sums[0], squares[0])
    _add_moments(y, counts_of_y, sums[1], squares[1])
    products = np.zeros((domains, columns // domains, columns // domains), dtype=np.float32)
    _add_products(gathered, y, covariance.shape[1], products)
    _centred(sums, squares, products, m + n, covariance.shape[1], covariance, first, second)


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
    """Write the cross-covariance and the centred square sums of two sets of pairs, in each of b domains.

    Points are paired with partners, sources with targets. The sums are not divided by the number of pairs.

    Parameters
    ----------
    points, partners : float32, shape (m, b w)
    sources, targets : float32, shape (n, b w)
    covariance : float32, shape (b, k, k)
        Written.
    first, second : float32, shape (b,)
        Written: square sums over each domain, of points and sources and of partners and targets.
    """
    columns, domains = points.shape[1], len(first)
    sums = np.zeros((2, columns), dtype=np.float32)
    squares = np.zeros((2, columns), dtype=np.float32)
    products = np.zeros((domains, columns // domains, columns // domains), dtype=np.float32)
    weights = np.ones(max(len(points), len(sources)), dtype=np.float32)
    _add_moments(points, weights, sums[0], squares[0])
    _add_moments(partners, weights, sums[1], squares[1])
    _add_products(points, partners, covariance.shape[1], products)
    _add_moments(sources, weights, sums[0], squares[0])
    _add_moments(targets, weights, sums[1], squares[1])
    _add_products(sources, targets, covariance.shape[1], products)
    _centred(
        sums, squares, products, len(points) + len(sources), covariance.shape[1], covariance, first, second
    )
