"""The match record of one shape: the arrays that the kernels read, encoded in one array."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Int16s, Int32s
from core.numerics.compilation import kernel

ONE = 32767
"""The integer that stands for 1 in a spline's matrix, whose entries lie in [-1, 1]."""

HEAD = 12
"""Numbers before the arrays, int32: m, d, s, b, k, j, the number of splines of a domain, and the key."""


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
    warp : int16, shape (b, m, m)
        The softer spline of all samples, symmetric, over `ONE`.
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
    warp: Int16s
    radius: Float32s
    key: Int32s


def encoded(record: MatchRecord) -> Float32s:
    """The match record as one array, float32, shape (l,); `decoded` reads it."""
    head = np.zeros(HEAD, dtype=np.int32)
    b, j, s = record.searched.shape
    d, columns = record.points.shape
    head[:7] = record.warp.shape[1], d, s, b, columns // b, j, record.operators.shape[1]
    head[7:11] = record.key
    arrays = (
        head,
        record.radius,
        record.points,
        record.offsets,
        record.members,
        record.operators,
        record.warp,
    )
    return np.concatenate([_floats(array) for array in arrays])


def _floats(array: NDArray[Any]) -> Float32s:
    """The bytes of an array as float32, filled up to whole ones."""
    data = np.ascontiguousarray(array).tobytes()
    return np.frombuffer(data + bytes(-len(data) % 4), dtype=np.float32)


@kernel
def decoded(record: Float32s) -> MatchRecord:
    """The arrays of an encoded match record: views of it, except `searched`, which is a copy."""
    head = record[:HEAD].view(np.int32)
    sizes = head.astype(np.int64)
    m, d, s, b, k, j, stages = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4], sizes[5], sizes[6]
    at = np.int64(HEAD)
    radius = record[at : at + b]
    at += b
    points = record[at : at + d * b * k].reshape((d, b * k))
    at += d * b * k
    offsets = record[at : at + m + 1].view(np.int32)
    at += m + 1
    members = record[at : at + d].view(np.int32)
    at += d
    length = (b * stages * s * s + 1) // 2
    operators = record[at : at + length].view(np.int16)[: b * stages * s * s].reshape((b, stages, s, s))
    at += length
    length = (b * m * m + 1) // 2
    warp = record[at : at + length].view(np.int16)[: b * m * m].reshape((b, m, m))
    searched = np.empty((b, j, s), dtype=np.float32)
    for block in range(b):
        for c in range(j):
            for i in range(s):
                searched[block, c, i] = points[i, block * k + c]
    return MatchRecord(points, searched, operators, offsets, members, warp, radius, head[7:11])


@kernel
def dequantised(matrix: Int16s) -> Float32s:
    """A spline's matrix of integers over `ONE`, shape (m, m), in float32."""
    m = len(matrix)
    found = np.empty((m, m), dtype=np.float32)
    for i in range(m):
        for j in range(m):
            found[i, j] = np.float32(matrix[i, j]) * np.float32(1.0 / ONE)
    return found
