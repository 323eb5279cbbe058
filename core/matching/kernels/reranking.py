"""The match of embedded points alone, with flat splines in place of those of a match record."""

import math

import numpy as np

from core.arrays import Bytes, Float32s, Int16s, Int32s, Ints
from core.matching.kernels.match_record import ONE, MatchRecord, decoded
from core.matching.kernels.pair_matching import SearchRounds, fit_map
from core.numerics.compilation import kernel

FLAT = 1e-6
"""The least norm of a new direction, over the norm of its coordinate, that is more than rounding."""

EXPONENT, LARGE = 0x7F800000, 0x7C000000
"""The bits of a float32 number's exponent, and the least exponent whose numbers times 128 are not finite."""


@kernel
def flat_splines(searched: Float32s, first: int, operators: Int16s) -> None:
    """Write the operators of splines that do not bend: projections that fit affine maps by least squares.

    Stiff splines are nearly these, and take a hundred times as long to make.

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
            # Twice, so that rounding leaves nothing of the other axes.
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
def sorted_regions(regions: Int32s, offsets: Int32s, members: Int32s) -> bool:
    """Write where each sample's region is, and its points.

    Parameters
    ----------
    regions : int32, shape (d,)
        The sample nearest to each point, at least 0.
    offsets : int32, shape (m + 1,)
        Written: sample i's region is `members[offsets[i]:offsets[i + 1]]`.
    members : int32, shape (d,)

    Returns
    -------
    bool
        Whether none is empty.
    """
    m = len(offsets) - 1
    offsets[:] = 0
    for i in range(len(regions)):
        offsets[regions[i] + 1] += 1
    whole = True
    for i in range(m):
        whole = whole and offsets[i + 1] > 0
        offsets[i + 1] += offsets[i]
    place = offsets.copy()
    for i in range(len(regions)):
        members[place[regions[i]]] = i
        place[regions[i]] += 1
    return whole


@kernel
def points_of(data: Bytes, columns: int) -> tuple[Float32s, Int32s]:
    """The coordinates, shape (d, columns), and regions, shape (d,), in the bytes of points.

    d is 0 if the bytes, a multiple of four, are not those of points in so many columns, or a coordinate is
    not finite.
    """
    nothing = np.empty((0, columns), dtype=np.float32), np.empty(0, dtype=np.int32)
    head = data.view(np.int32)
    if len(head) < 2 or head[0] < 1 or head[1] != columns:
        return nothing
    d = np.int64(head[0])
    start = 8 + 4 * columns + 4 * d
    if len(data) != (start + d * columns + 3) // 4 * 4:
        return nothing
    # Fast arithmetic assumes finite numbers: look at the bits.
    if ((head[2 : 2 + columns] & EXPONENT) >= LARGE).any():
        return nothing
    scales = data[8 : 8 + 4 * columns].view(np.float32)
    whole = data[start : start + d * columns].view(np.int8)
    cloud = np.empty((d, columns), dtype=np.float32)
    for i in range(d):
        for c in range(columns):
            cloud[i, c] = np.float32(whole[i * columns + c]) * scales[c]
    return cloud, data[8 + 4 * columns : start].view(np.int32)


@kernel
def rerank_many(
    query: Float32s,
    others: Bytes,
    ends: Ints,
    search: Ints,
    rounds: SearchRounds,
    scores: Float32s,
) -> None:
    """Write CC of one shape and each of c others, whose splines are flat.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.kernels.match_record`.
    others : uint8, shape (l_1 + ... + l_c,)
        The points of the others, one shape after another: see `core.ranking.quantised_points`. Each l_i is a
        multiple of four.
    ends : int64, shape (c,)
        The end of each shape in `others`.
    search : int64, shape (2,)
        The largest number of samples in the search, and the dimensions of the first stage.
    rounds : SearchRounds
    scores : float32, shape (c,)
        Written. -2 if the bytes are not those of points in b k columns, a coordinate is not finite, or a
        region is not that of a sample.
    """
    x = decoded(query)
    columns = x.points.shape[1]
    m = len(x.offsets) - 1
    domains, dimensions, _ = x.searched.shape
    k = columns // domains
    stages = dimensions - search[1] + 1
    there = np.empty(m, dtype=np.int32)
    partners = np.empty((m, columns), dtype=np.float32)
    rotation = np.empty((columns, columns), dtype=np.float32)
    for i in range(len(ends)):
        scores[i] = -2.0
        start = ends[i - 1] if i else 0
        cloud, nearest = points_of(others[start : ends[i]], columns)
        d = len(nearest)
        if d == 0:
            continue
        low, high = nearest.min(), nearest.max()
        if low < 0 or high >= d:
            continue
        n = high + 1
        offsets = np.empty(n + 1, dtype=np.int32)
        members = np.empty(d, dtype=np.int32)
        if not sorted_regions(nearest, offsets, members):
            continue
        some = min(search[0], n)
        searched = np.empty((domains, dimensions, some), dtype=np.float32)
        for block in range(domains):
            for c in range(dimensions):
                for j in range(some):
                    searched[block, c, j] = cloud[j, block * k + c]
        operators = np.empty((domains, stages, some, some), dtype=np.int16)
        flat_splines(searched, search[1], operators)
        back = np.empty(n, dtype=np.int32)
        sources = np.empty((n, columns), dtype=np.float32)
        rotation[:] = 0.0
        # fit_map reads no warp, radius or key: the query's stand in.
        y = MatchRecord(cloud, searched, operators, offsets, members, x.warp, x.radius, x.key)
        scores[i] = fit_map(x, y, rounds, there, back, partners, sources, rotation)
