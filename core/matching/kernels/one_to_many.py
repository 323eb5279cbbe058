"""One shape against many: in full by match records, and roughly by coarse samples."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Ints
from core.matching.kernels.match_record import MatchRecord, decoded
from core.matching.kernels.pair_matching import SearchRounds, best_map, match_pair
from core.numerics.compilation import kernel

COARSE_SAMPLES = 32
"""Samples of each shape that a coarse ranking reads."""


@kernel
def precedes(x: MatchRecord, y: MatchRecord) -> int:
    """1 if x comes first of the two (the smaller, then by key), 0 if both are one shape, else -1."""
    m = len(x.offsets)
    n = len(y.offsets)
    if m != n:
        return 1 if m < n else -1
    one = x.key.view(np.uint32)
    other = y.key.view(np.uint32)
    for part in range(len(one)):
        if one[part] != other[part]:
            return 1 if one[part] < other[part] else -1
    return 0


@kernel
def match_many(query: Float32s, records: Float32s, ends: Ints, rounds: SearchRounds, scores: Floats) -> None:
    """Write CC, SSD and sim of one shape and each of c others, the same whichever of two is the query.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.kernels.match_record`.
    records : float32, shape (l_1 + ... + l_c,)
        The match records of the others, one after another.
    ends : int64, shape (c,)
        The end of each in `records`.
    rounds : SearchRounds
    scores : float64, shape (c, 3)
        Written.
    """
    x = decoded(query)
    rotation = np.empty((x.points.shape[1], x.points.shape[1]), dtype=np.float32)
    for i in range(len(ends)):
        y = decoded(records[ends[i - 1] if i else 0 : ends[i]])
        order = precedes(x, y)
        there = np.empty(len(x.offsets) - 1, dtype=np.int32)
        back = np.empty(len(y.offsets) - 1, dtype=np.int32)
        if order < 0:
            match_pair(y, x, rounds, False, back, there, rotation, scores[i])
        else:
            match_pair(x, y, rounds, order == 0, there, back, rotation, scores[i])


@kernel
def coarse_rank_many(
    query: Float32s, coarse_samples: NDArray[np.uint8], rounds: SearchRounds, scores: Float32s
) -> None:
    """Write the approximate CC of one shape and each of c others: see `core.ranking.coarse_ranking`.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record.
    coarse_samples : uint8, shape (c, 4 + 36 b k)
    rounds : SearchRounds
        Of one side.
    scores : float32, shape (c,)
        Written.
    """
    x = decoded(query)
    columns = x.points.shape[1]
    blocks, dimensions, _ = x.searched.shape
    k = columns // blocks
    rotation = np.empty((columns, columns), dtype=np.float32)
    for i in range(len(coarse_samples)):
        count = int(coarse_samples[i, :4].view(np.int32)[0])
        if count == 0:
            scores[i] = -1.0
            continue
        scales = coarse_samples[i, 4 : 4 + 4 * columns].view(np.float32)
        whole = coarse_samples[i, 4 + 4 * columns :].view(np.int8)
        points = np.empty((count, columns), dtype=np.float32)
        for j in range(count):
            for c in range(columns):
                points[j, c] = np.float32(whole[j * columns + c]) * scales[c]
        searched = np.empty((blocks, dimensions, count), dtype=np.float32)
        for block in range(blocks):
            for c in range(dimensions):
                for j in range(count):
                    searched[block, c, j] = points[j, block * k + c]
        places = np.arange(count + 1).astype(np.int32)
        # A search from one side reads no splines of the other, and no warp or radius.
        y = MatchRecord(points, searched, x.operators, places, places, x.warp, x.radius, x.key)
        scores[i] = best_map(x, y, rounds, rotation)
