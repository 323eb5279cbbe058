"""The match record of one shape: the arrays that the kernels read, decoded from one array."""

from typing import NamedTuple

import numpy as np

from core.arrays import Float32s, Int8s, Int16s, Int32s
from core.matching.kernels.points import points_of, sorted_regions
from core.numerics.compilation import kernel

ONE = 32767
"""The integer that stands for 1 in a spline's matrix, whose entries lie in [-1, 1]."""

ROOT = 128
"""The integer that stands for the cube root of 1: most entries of the softer spline are small, and roots keep
small numbers finer than large ones."""

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
    operators : int16, shape (b, stages, s, s)
        Their splines, over `ONE`.
    offsets : int32, shape (m + 1,)
        Sample i's region is `members[offsets[i]:offsets[i + 1]]`.
    members : int32, shape (d,)
    warp : int8, shape (b, m (m - 1) / 2)
        The softer spline of all samples: cube roots of the entries below the diagonal, row after row, over
        `ROOT`. It is symmetric, and its rows sum to 1.
    radius : float32, shape (b,)
        Mean distance of the samples from their centroid.
    key : int32, shape (4,)
        A hash of the shape.
    """

    points: Float32s
    searched: Float32s
    operators: Int16s
    offsets: Int32s
    members: Int32s
    warp: Int8s
    radius: Float32s
    key: Int32s


@kernel
def decoded(record: Float32s) -> MatchRecord:
    """Return the arrays of a match record that `core.matching.match_records.encoded` made, mostly copies."""
    head = record[:HEAD].view(np.int32)
    sizes = head.astype(np.int64)
    m, length, s, b, k, j, stages = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4], sizes[5], sizes[6]
    # The arrays follow one another in the order of `encoded`; two int16 numbers take one place.
    start = np.int64(HEAD)
    radius = record[start : start + b]
    start += b
    points, regions = points_of(record[start : start + length // 4].view(np.uint8), b * k)
    offsets, members = sorted_regions(regions)
    start += length // 4
    length = (b * stages * (s * (s + 1) // 2) + 1) // 2
    operators = symmetric(record[start : start + length].view(np.int16), b * stages, s)
    start += length
    warp = record[start:].view(np.int8)[: b * (m * (m - 1) // 2)]
    return MatchRecord(
        points,
        searched_columns(points, b, j, s),
        operators.reshape((b, stages, s, s)),
        offsets,
        members,
        warp.reshape((b, m * (m - 1) // 2)),
        radius,
        head[7:11],
    )


@kernel
def symmetric(triangles: Int16s, count: int, m: int) -> Int16s:
    """Return symmetric matrices, shape (count, m, m), of their lower triangles, row after row."""
    matrices = np.empty((count, m, m), dtype=np.int16)
    place = 0
    for matrix in range(count):
        for i in range(m):
            for j in range(i + 1):
                matrices[matrix, i, j] = triangles[place + j]
                matrices[matrix, j, i] = triangles[place + j]
            place += i + 1
    return matrices


@kernel
def lower_triangle(roots: Int8s, m: int) -> Float32s:
    """Return the entries of a matrix below the diagonal, shape (m, m), of their cube roots over `ROOT`."""
    matrix = np.zeros((m, m), dtype=np.float32)
    place = 0
    for i in range(m):
        for j in range(i):
            root = np.float32(roots[place + j]) * np.float32(1.0 / ROOT)
            matrix[i, j] = root * root * root
        place += i
    return matrix


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
def dequantised(matrix: Int16s) -> Float32s:
    """Return a spline's matrix of integers over `ONE`, shape (m, m), in float32."""
    m = len(matrix)
    floats = np.empty((m, m), dtype=np.float32)
    for i in range(m):
        for j in range(m):
            floats[i, j] = np.float32(matrix[i, j]) * np.float32(1.0 / ONE)
    return floats


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
