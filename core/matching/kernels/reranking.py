"""The match of embedded points alone, with flat splines in place of those of a match record."""

import math

import numpy as np

from core.arrays import Float32s, Int16s, Int32s, Ints
from core.matching.kernels.match_record import ONE, MatchRecord, decoded
from core.matching.kernels.pair_matching import SearchRounds, fit_map
from core.numerics.compilation import kernel

FLAT = 1e-6
"""The least norm of a new direction, over the norm of its coordinate, that is more than rounding."""


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
def rerank_many(
    query: Float32s,
    points: Float32s,
    regions: Int32s,
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
    points : float32, shape (d_1 + ... + d_c, b k)
        Coordinates of the others, one shape after another; finite.
    regions : int32, shape (d_1 + ... + d_c,)
        The sample nearest to each point.
    ends : int64, shape (c,)
        The end of each shape in `points` and `regions`; none is empty.
    search : int64, shape (2,)
        The largest number of samples in the search, and the dimensions of the first stage.
    rounds : SearchRounds
    scores : float32, shape (c,)
        Written. -2 if a region is not that of a sample.
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
        cloud, nearest = points[start : ends[i]], regions[start : ends[i]]
        d = len(nearest)
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
