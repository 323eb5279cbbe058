"""Quantised points as the kernels read them, and the regions of the samples."""

import numpy as np

from core.arrays import Bytes, Float32s, Int32s
from core.matching.kernels.simd import SUMS, load, load_whole, store
from core.numerics.compilation import kernel

EXPONENT, LARGE = 0x7F800000, 0x71800000
"""The bits of a float32 number's exponent, and those of 2^100: larger units and samples are refused."""


@kernel
def points_of(data: Bytes, columns: int) -> tuple[Float32s, Int32s]:
    """Return the coordinates, shape (d, columns), and regions, shape (d,), in the bytes of quantised points.

    d is 0 if the bytes, a multiple of four, are not those of points in so many columns, a coordinate is not
    finite, or a region is not that of a sample. `core.matching.quantised_points` is the reference.
    """
    nothing = np.empty((0, columns), dtype=np.float32), np.empty(0, dtype=np.int32)
    head = data.view(np.int32)
    if len(head) < 3 or head[1] < 1 or head[0] < head[1] or head[2] != columns:
        return nothing
    # The length that the numbers of points, samples and columns ask for.
    d = np.int64(head[0])
    m = np.int64(head[1])
    samples_start = np.int64(12 + 8 * columns)
    regions_start = samples_start + (2 if d > m else 4) * m * columns
    offsets_start = regions_start + 2 * (d - m)
    stop = offsets_start + (d - m) * columns
    if len(data) != (stop + 3) // 4 * 4:
        return nothing
    # Fast arithmetic assumes finite numbers: look at the bits.
    for c in range(2 * columns):
        if (head[3 + c] & EXPONENT) >= LARGE:
            return nothing
    units = data[12:samples_start].view(np.float32)
    samples = data[samples_start:regions_start]
    near = data[regions_start:offsets_start].view(np.uint16)
    offsets = data[offsets_start:stop].view(np.int8)
    points = np.empty((d, columns), dtype=np.float32)
    regions = np.empty(d, dtype=np.int32)
    vectors = columns - columns % SUMS
    # The samples: whole numbers over their units, or floats where there are no other points.
    whole = samples.view(np.int16)
    bits = samples[: len(samples) // 4 * 4].view(np.int32)
    floats = bits.view(np.float32)
    for i in range(m):
        regions[i] = i
        place = i * columns
        if d > m:
            for c in range(0, vectors, SUMS):
                store(load_whole(whole, place + c, SUMS) * load(units, c, SUMS), points, place + c)
            for c in range(vectors, columns):
                points[i, c] = np.float32(whole[place + c]) * units[c]
            continue
        for c in range(columns):
            if (bits[place + c] & EXPONENT) >= LARGE:
                return nothing
            points[i, c] = floats[place + c]
    # The other points: offsets over their units from a sample.
    for i in range(d - m):
        region = int(near[i])
        if region >= m:
            return nothing
        regions[m + i] = region
        start, sample = i * columns, region * columns
        for c in range(0, vectors, SUMS):
            offset = load_whole(offsets, start + c, SUMS) * load(units, columns + c, SUMS)
            store(load(points, sample + c, SUMS) + offset, points, int(m) * columns + start + c)
        for c in range(vectors, columns):
            step = np.float32(offsets[start + c]) * units[columns + c]
            points[m + i, c] = points[region, c] + step
    return points, regions


@kernel
def sorted_regions(regions: Int32s) -> tuple[Int32s, Int32s]:
    """Return offsets, shape (m + 1,), and members, shape (d,), of the regions of m samples, shape (d,).

    Sample i's region is `members[offsets[i]:offsets[i + 1]]`.
    """
    m = 0
    for i in range(len(regions)):
        m = max(m, int(regions[i]) + 1)
    # A counting sort: sizes of the regions, where they begin, and then each point to its place.
    offsets = np.zeros(m + 1, dtype=np.int32)
    members = np.empty(len(regions), dtype=np.int32)
    for i in range(len(regions)):
        offsets[regions[i] + 1] += 1
    for i in range(m):
        offsets[i + 1] += offsets[i]
    following = offsets.copy()
    for i in range(len(regions)):
        members[following[regions[i]]] = i
        following[regions[i]] += 1
    return offsets, members
