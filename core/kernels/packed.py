"""What the kernels read of one shape, and the one row of bytes that it is kept in."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import carray  # type: ignore[attr-defined]
from numpy.typing import NDArray

from core.compiled import kernel
from core.embedding import Float32s, Int32s
from core.kernels.lanes import floats_at

Int16s = NDArray[np.int16]

ONE = 32767
"""What 1 is in a spline's matrix, which is kept in whole numbers: its entries lie in [-1, 1]."""

FLAT = 1e-6
"""The least length of what is new in a coordinate, over its own, that is more than rounding."""

HEAD = 12
"""Numbers before a row's arrays, int32: m, d, s, b, k, j, splines of a domain, key, the softer one's side."""


Sizes = tuple[int, int, int, int, int]


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
    head[:7] = len(shape.offsets) - 1, d, s, b, columns // b, j, shape.operators.shape[1]
    head[7:11] = shape.key
    head[11] = shape.warp.shape[1]
    arrays = (head, shape.radius, shape.points, shape.offsets, shape.members, shape.operators, shape.warp)
    return np.concatenate([_floats(array) for array in arrays])


def _floats(array: NDArray[Any]) -> Float32s:
    """The bytes of an array as float32, filled up to whole ones."""
    data = np.ascontiguousarray(array).tobytes()
    return np.frombuffer(data + bytes(-len(data) % 4), dtype=np.float32)


@kernel
def flat_splines(searched: Float32s, first: int, operators: Int16s) -> None:
    """Write what splines of no bending make of targets: the least-squares affine map of each dimension.

    Stiff splines are nearly that, and these take a hundredth of their time.

    Parameters
    ----------
    searched : float32, shape (b, j, s)
    first : int
        Dimensions of the first stage.
    operators : int16, shape (b, j - first + 1, s, s)
        Written, over `ONE`: projections onto the constants and the first coordinates.
    """
    b, j, s = searched.shape
    axes = np.empty((j + 1, s), dtype=np.float32)
    for block in range(b):
        projection = np.full((s, s), np.float32(1.0 / s))
        axes[0] = np.float32(1.0 / math.sqrt(s))
        known = 1
        for c in range(j):
            axis = axes[known]
            axis[:] = searched[block, c]
            size = math.sqrt(np.dot(axis, axis))
            # Twice, so that rounding leaves nothing of the others.
            for _ in range(2):
                for other in range(known):
                    axis -= np.dot(axes[other], axis) * axes[other]
            left = math.sqrt(np.dot(axis, axis))
            if left > FLAT * size:
                axis *= np.float32(1.0 / left)
                for i in range(s):
                    for place in range(s):
                        projection[i, place] += axis[i] * axis[place]
                known += 1
            if c + 1 >= first:
                for i in range(s):
                    for place in range(s):
                        whole = np.rint(projection[i, place] * np.float32(ONE))
                        operators[block, c + 1 - first, i, place] = np.int16(min(max(whole, -ONE), ONE))


@kernel
def points_row(
    points: Float32s, regions: Int32s, sizes: tuple[int, int, int, int, int], row: Float32s
) -> bool:
    """Write the row of a shape with flat splines to search by, and without the softer spline.

    Parameters
    ----------
    points : float32, shape (d, b k)
    regions : int32, shape (d,)
        The sample nearest to each point, in [0, m).
    sizes : tuple of int
        m; how many of the samples and in how many dimensions is searched, from how many on; and b.
    row : float32, shape (12 + b + d b k + m + 1 + d + l,)
        l is half of the numbers of the splines, rounded up.

    Returns
    -------
    bool
        Whether every region is a sample's; else the row is of no use.
    """
    samples, some, searched, first, blocks = sizes
    d, columns = points.shape
    stages = searched - first + 1
    row[:] = 0.0
    head = row.view(np.int32)
    head[0] = samples
    head[1] = d
    head[2] = some
    head[3] = blocks
    head[4] = columns // blocks
    head[5] = searched
    head[6] = stages
    at = HEAD + blocks
    row[at : at + d * columns] = points.reshape(d * columns)
    at += d * columns
    offsets = head[at : at + samples + 1]
    at += samples + 1
    members = head[at : at + d]
    at += d
    for i in range(d):
        if regions[i] < 0 or regions[i] >= samples:
            return False
        offsets[regions[i] + 1] += 1
    for i in range(samples):
        offsets[i + 1] += offsets[i]
    place = offsets.copy()
    for i in range(d):
        members[place[regions[i]]] = i
        place[regions[i]] += 1
    operators = row[at:].view(np.int16)[: blocks * stages * some * some]
    flat_splines(unpacked(row).searched, first, operators.reshape((blocks, stages, some, some)))
    return True


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
    side = sizes[11]
    length = (b * side * side + 1) // 2
    warp = row[at : at + length].view(np.int16)[: b * side * side].reshape((b, side, side))
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
