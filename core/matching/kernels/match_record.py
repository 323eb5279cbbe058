"""What the kernels read of one shape, and the one row of bytes that it is kept in."""

from typing import Any, NamedTuple

import numpy as np
from numba import carray  # type: ignore[attr-defined]
from numpy.typing import NDArray

from core.arrays import Float32s, Int16s, Int32s
from core.matching.kernels.simd import floats_at
from core.numerics.compilation import kernel

ONE = 32767
"""What 1 is in a spline's matrix, which is kept in whole numbers: its entries lie in [-1, 1]."""

HEAD = 12
"""Numbers before a row's arrays, int32: m, d, s, b, k, j, how many splines a domain has, and the key."""


class Packed(NamedTuple):
    """What the kernels read of one shape with m samples and d embedded points, in b domains of k dimensions.

    Attributes
    ----------
    points : float32, shape (d, b k)
        Spectral coordinates side by side, the samples first.
    searched : float32, shape (b, j, s)
        By columns: the first samples and dimensions, where the search goes.
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


def packed_row(shape: Packed) -> Float32s:
    """The shape as one row, float32, shape (l,), of which `unpacked` makes it again."""
    head = np.zeros(HEAD, dtype=np.int32)
    b, j, s = shape.searched.shape
    d, columns = shape.points.shape
    head[:7] = shape.warp.shape[1], d, s, b, columns // b, j, shape.operators.shape[1]
    head[7:11] = shape.key
    arrays = (head, shape.radius, shape.points, shape.offsets, shape.members, shape.operators, shape.warp)
    return np.concatenate([_floats(array) for array in arrays])


def _floats(array: NDArray[Any]) -> Float32s:
    """The bytes of an array as float32, filled up to whole ones."""
    data = np.ascontiguousarray(array).tobytes()
    return np.frombuffer(data + bytes(-len(data) % 4), dtype=np.float32)


@kernel
def unpacked(row: Float32s) -> Packed:
    """The shape in a row: views of it, but for `searched`."""
    head = row[:HEAD].view(np.int32)
    sizes = head.astype(np.int64)
    m, d, s, b, k, j, stages = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4], sizes[5], sizes[6]
    at = np.int64(HEAD)
    radius = row[at : at + b]
    at += b
    points = row[at : at + d * b * k].reshape((d, b * k))
    at += d * b * k
    offsets = row[at : at + m + 1].view(np.int32)
    at += m + 1
    members = row[at : at + d].view(np.int32)
    at += d
    length = (b * stages * s * s + 1) // 2
    operators = row[at : at + length].view(np.int16)[: b * stages * s * s].reshape((b, stages, s, s))
    at += length
    length = (b * m * m + 1) // 2
    warp = row[at : at + length].view(np.int16)[: b * m * m].reshape((b, m, m))
    searched = np.empty((b, j, s), dtype=np.float32)
    for block in range(b):
        for c in range(j):
            for i in range(s):
                searched[block, c, i] = points[i, block * k + c]
    return Packed(points, searched, operators, offsets, members, warp, radius, head[7:11])


@kernel
def opened(matrix: Int16s) -> Float32s:
    """A spline's matrix, shape (m, m), as it was, float32."""
    m = len(matrix)
    found = np.empty((m, m), dtype=np.float32)
    for i in range(m):
        for j in range(m):
            found[i, j] = np.float32(matrix[i, j]) * np.float32(1.0 / ONE)
    return found


@kernel
def row_at(address: int, length: int) -> Float32s:
    """The row of float32 at an address of memory, which must stay while the row is read."""
    return carray(floats_at(address), (length,))
