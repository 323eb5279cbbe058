"""The match record of one shape: the arrays that the kernels read, decoded from one array."""

from typing import NamedTuple

import numpy as np

from core.arrays import Float32s, Int8s, Int16s, Int32s
from core.matching.kernels.points import points_of, sorted_regions
from core.matching.kernels.simd import SIMD_WIDTH, load, load_whole, repeat, store, whole_vectors
from core.numerics.compilation import inlined, kernel

ONE = 16382
"""The integer that stands for 1 in a spline's matrix. Its eigenvalues lie in [0, 1], so entries beside the
diagonal lie in [-1/2, 1/2] and fill 14 bits."""

ROOT = 160
"""The integer that stands for the cube root of 1: most entries of the softer spline are small, and roots keep
small numbers finer than large ones. The cube root of 1/2 fills 8 bits."""

HEAD = 12
"""Numbers before the arrays, int32: m, bytes of the points, s, b, k, j, splines of a domain, and the key."""


class MatchRecord(NamedTuple):
    """One shape with m samples and d embedded points, in b domains of k dimensions.

    Attributes
    ----------
    points : float32, shape (d, b k)
        Spectral coordinates side by side, the samples first.
    searched : float32, shape (b, j, s)
        The first samples and dimensions, by columns: the search reads these alone.
    operators : float32, shape (b, stages, s, w)
        Their splines, with rows of whole vectors.
    offsets : int32, shape (m + 1,)
        Sample i's region is `members[offsets[i]:offsets[i + 1]]`.
    members : int32, shape (d,)
    warp : float32, shape (b, m, m)
        The softer spline of all samples: the entries below the diagonal, and zeros. It is symmetric, and its
        rows sum to 1.
    radius : float32, shape (b,)
        Mean distance of the samples from their centroid.
    key : int32, shape (4,)
        A hash of the shape.
    """

    points: Float32s
    searched: Float32s
    operators: Float32s
    offsets: Int32s
    members: Int32s
    warp: Float32s
    radius: Float32s
    key: Int32s


@kernel
def decoded(record: Float32s) -> MatchRecord:
    """Return the arrays of a match record that `core.matching.match_records.encoded` made, mostly copies."""
    head = record[:HEAD].view(np.int32)
    sizes = head.astype(np.int64)
    m, length, s, b, k, j, stages = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4], sizes[5], sizes[6]
    # The arrays follow one another in the order of `encoded`, each in whole float32 places.
    start = np.int64(HEAD)
    radius = record[start : start + b]
    start += b
    points, regions = points_of(record[start : start + length // 4].view(np.uint8), b * k)
    offsets, members = sorted_regions(regions)
    start += length // 4
    # Seven words of 16 bits for eight entries.
    length = (7 * ((b * stages * (s * (s - 1) // 2) + 7) // 8) + 1) // 2
    operators = symmetric(record[start : start + length].view(np.int16), b, stages, s)
    start += length
    warp = lower_triangles(record[start:].view(np.int8), b, m)
    return MatchRecord(
        points, searched_columns(points, b, j, s), operators, offsets, members, warp, radius, head[7:11]
    )


@kernel
def symmetric(words: Int16s, domains: int, stages: int, s: int) -> Float32s:
    """Return symmetric matrices whose rows sum to 1, of their entries below the diagonal, row after row.

    The entries are `whole_entries` over `ONE`. The result has rows of whole vectors, shape (b, stages, s, w).
    """
    whole = whole_entries(words, domains * stages * (s * (s - 1) // 2))
    width = whole_vectors(s)
    matrices = np.empty((domains, stages, s, width), dtype=np.float32)
    sums = np.empty(s, dtype=np.int32)
    place = 0
    for which in range(domains * stages):
        start = which * s * width
        matrix = matrices[which // stages, which % stages]
        for i in range(s):
            # Numbers from the diagonal on are overwritten, in turn with the rows below.
            _write_whole(whole, place, i, np.float32(1.0 / ONE), matrices, start + i * width)
            row = whole[place : place + i]
            place += i
            for j in range(i):
                matrix[j, i] = matrix[i, j]
            # Sums of the rows beside the diagonal; those below add to this one.
            total = np.int32(0)
            for j in range(i):
                total += np.int32(row[j])
            for j in range(i):
                sums[j] += np.int32(row[j])
            sums[i] = total
        # The diagonal brings each sum to 1: the spline reproduces constants.
        for i in range(s):
            matrix[i, i] = np.float32(ONE - sums[i]) * np.float32(1.0 / ONE)
            for j in range(s, width):
                matrix[i, j] = np.float32(0.0)
    return matrices


@kernel
def whole_entries(words: Int16s, count: int) -> Int16s:
    """Return so many whole numbers of 14 bits, of words of 16.

    The words are seven eighths of the numbers, in the upper 14 bits. Two bits of each number of the last
    eighth are the lower bits of a word of each of the others.
    """
    length = (count + 7) // 8
    whole = np.zeros(8 * length, dtype=np.int16)
    last = whole[7 * length :]
    for part in range(7):
        some = words[part * length : (part + 1) * length]
        numbers = whole[part * length : (part + 1) * length]
        shift = np.int16(2 * part)
        for entry in range(length):
            numbers[entry] = some[entry] >> np.int16(2)
            last[entry] |= (some[entry] & np.int16(3)) << shift
    # The sign of a number of 14 bits.
    for entry in range(length):
        last[entry] = np.int16(last[entry] << np.int16(2)) >> np.int16(2)
    return whole[:count]


@kernel
def lower_triangles(roots: Int8s, domains: int, m: int) -> Float32s:
    """Return the entries of matrices below the diagonal, shape (b, m, m), of their cube roots over `ROOT`."""
    numbers = np.zeros(domains * m * m + SIMD_WIDTH, dtype=np.float32)
    place = 0
    for row in range(domains * m):
        start, count = row * m, row % m
        # Numbers beyond the diagonal give way to zeros, and those beyond the row to the next row.
        _write_whole(roots, place, count, np.float32(1.0 / ROOT), numbers, start)
        for j in range(start, start + count, SIMD_WIDTH):
            entries = load(numbers, j, SIMD_WIDTH)
            store(entries * entries * entries, numbers, j)
        store(repeat(np.float32(0.0), SIMD_WIDTH), numbers, start + count)
        place += count
    return numbers[: domains * m * m].reshape((domains, m, m))


@inlined
def _write_whole(
    whole: Int8s | Int16s, place: int, count: int, unit: np.float32, out: Float32s, start: int
) -> None:
    """Write so many whole numbers times their unit, and those that follow up to whole vectors."""
    for j in range(0, count, SIMD_WIDTH):
        if place + j + SIMD_WIDTH <= len(whole):
            numbers = load_whole(whole, place + j, SIMD_WIDTH)
            store(numbers * repeat(unit, SIMD_WIDTH), out, start + j)
        else:
            for last in range(j, count):
                store(load_whole(whole, place + last, 1) * repeat(unit, 1), out, start + last)


@kernel
def searched_columns(points: Float32s, domains: int, dimensions: int, samples: int) -> Float32s:
    """Return the first samples and dimensions of each domain, by columns, shape (b, j, s).

    Parameters
    ----------
    points : float32, shape (d, b k)
    domains, dimensions, samples : int
        b, j <= k and s <= d.
    """
    k = points.shape[1] // domains
    searched = np.empty((domains, dimensions, samples), dtype=np.float32)
    for domain in range(domains):
        for c in range(dimensions):
            for i in range(samples):
                searched[domain, c, i] = points[i, domain * k + c]
    return searched


@kernel
def precedes(x: MatchRecord, y: MatchRecord) -> int:
    """Return 1 if x comes first of the two (the smaller, then by key), 0 if both are one shape, else -1."""
    m = len(x.offsets)
    n = len(y.offsets)
    if m != n:
        return 1 if m < n else -1
    key_of_x = x.key.view(np.uint32)
    key_of_y = y.key.view(np.uint32)
    for part in range(len(key_of_x)):
        if key_of_x[part] != key_of_y[part]:
            return 1 if key_of_x[part] < key_of_y[part] else -1
    return 0
