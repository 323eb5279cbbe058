"""The match of quantised samples alone, with flat splines in place of those of a match record."""

import math

import numpy as np

from core.arrays import Bytes, Float32s, Int16s, Ints
from core.matching.kernels.match_record import ONE, MatchRecord, decoded, first_by_columns
from core.matching.kernels.pair_matching import SearchRounds, fit_map
from core.matching.kernels.quantised_samples import samples_of
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
        The samples of the others, one shape after another: see `core.ranking.quantised_samples`. Each l_i is
        a multiple of four.
    ends : int64, shape (c,)
        The end of each shape in `others`.
    search : int64, shape (2,)
        The largest number of samples in the search, and the dimensions of the first stage.
    rounds : SearchRounds
        With no slides.
    scores : float32, shape (c,)
        Written. -2 if the bytes are not those of samples in b k columns, or a coordinate is not finite.
    """
    x = decoded(query)
    columns = x.points.shape[1]
    m = len(x.offsets) - 1
    domains, dimensions, _ = x.searched.shape
    stages = dimensions - search[1] + 1
    there = np.empty(m, dtype=np.int32)
    partners = np.empty((m, columns), dtype=np.float32)
    rotation = np.empty((columns, columns), dtype=np.float32)
    for i in range(len(ends)):
        scores[i] = -2.0
        start = ends[i - 1] if i else 0
        samples = samples_of(others[start : ends[i]], columns)
        n = len(samples)
        if n == 0 or ends[i] - start != (4 + 4 * columns + n * columns + 3) // 4 * 4:
            continue
        some = min(search[0], n)
        searched = first_by_columns(samples, domains, dimensions, some)
        operators = np.empty((domains, stages, some, some), dtype=np.int16)
        flat_splines(searched, search[1], operators)
        back = np.empty(n, dtype=np.int32)
        sources = np.empty((n, columns), dtype=np.float32)
        rotation[:] = 0.0
        places = np.arange(n + 1).astype(np.int32)
        # fit_map reads no warp, radius or key: the query's stand in.
        y = MatchRecord(samples, searched, operators, places, places, x.warp, x.radius, x.key)
        scores[i] = fit_map(x, y, rounds, there, back, partners, sources, rotation)
