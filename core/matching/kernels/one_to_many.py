"""One shape matched with many others, in each of the two forms in which others are held.

Match records are matched in full. Coarse samples have flat splines in place of those of a match record, and
give an approximate CC.
"""

import math

import numpy as np

from core.arrays import Bytes, Float32s, Floats, Ints
from core.matching.kernels.match_record import MatchRecord, decoded, precedes, searched_columns
from core.matching.kernels.pair_matching import copy_matrix, fit_maps, pair_of, score_pairs
from core.matching.kernels.simd import whole_vectors
from core.matching.kernels.spline_search import SearchRounds
from core.numerics.compilation import kernel

MATCH_RECORD, COARSE_SAMPLES = 0, 1
"""The form of the others: encoded match records, or coarse samples (`core.ranking.reranking`)."""

PAIRS_TOGETHER = 4
"""Shapes that are matched together: their maps fill the lanes of `core.matching.kernels.procrustes`."""

NEW_DIRECTION = 1e-6
"""The least norm of a new direction, over the norm of its coordinate, that is more than rounding."""


@kernel
def flat_splines(searched: Float32s, first: int, operators: Float32s) -> None:
    """Write the operators of splines that do not bend: projections that fit affine maps by least squares.

    Stiff splines are nearly these, and take a hundred times as long to make.

    Parameters
    ----------
    searched : float32, shape (b, j, s)
    first : int
        Dimensions of the first stage.
    operators : float32, shape (b, j - first + 1, s, w)
        Written: projections onto the constants and the first coordinates.
    """
    b, j, s = searched.shape
    axes = np.empty((j + 1, s), dtype=np.float32)
    for block in range(b):
        # The projection onto the constants.
        projection = np.full((s, s), np.float32(1.0 / s))
        for i in range(s):
            axes[0, i] = np.float32(1.0 / math.sqrt(s))
        known = 1
        for c in range(j):
            # The part of the next coordinate that is orthogonal to the axes before it.
            axis = axes[known]
            for i in range(s):
                axis[i] = searched[block, c, i]
            size = math.sqrt(np.dot(axis, axis))
            # Twice, so that rounding leaves nothing of the other axes.
            for _ in range(2):
                for before in range(known):
                    along = np.dot(axes[before], axis)
                    for i in range(s):
                        axis[i] -= along * axes[before, i]
            # It joins the projection, unless it is rounding.
            length = math.sqrt(np.dot(axis, axis))
            if length > NEW_DIRECTION * size:
                scale = np.float32(1.0 / length)
                for i in range(s):
                    axis[i] *= scale
                for i in range(s):
                    for column in range(s):
                        projection[i, column] += axis[i] * axis[column]
                known += 1
            if c + 1 >= first:
                for i in range(s):
                    for column in range(s):
                        operators[block, c + 1 - first, i, column] = projection[i, column]


@kernel
def dequantised_points(whole: Bytes, scales: Float32s) -> Float32s:
    """Return coordinates in int8, row after row, times the scales of their columns, shape (d, columns)."""
    numbers = whole.view(np.int8)
    columns = len(scales)
    points = np.empty((len(numbers) // columns, columns), dtype=np.float32)
    for i in range(len(points)):
        for c in range(columns):
            points[i, c] = np.float32(numbers[i * columns + c]) * scales[c]
    return points


@kernel
def record_of_samples(data: Bytes, x: MatchRecord, rounds: SearchRounds) -> MatchRecord:
    """Return a match record of samples without regions, and with the warp, radius and key of x.

    Its splines are flat.
    """
    domains, dimensions, _ = x.searched.shape
    columns = x.points.shape[1]
    # Damaged samples may count below zero.
    count = min(max(int(data[:4].view(np.int32)[0]), 0), rounds.align_samples)
    start = 4 + 4 * columns
    points = dequantised_points(data[start : start + count * columns], data[4:start].view(np.float32))
    # Damaged samples may be fewer than they say.
    count = len(points)
    samples = min(rounds.search_samples, count)
    searched = searched_columns(points, domains, dimensions, samples)
    operators = x.operators
    if samples > 0:
        stages = dimensions - rounds.first_dimensions + 1
        operators = np.zeros((domains, stages, samples, whole_vectors(samples)), dtype=np.float32)
        flat_splines(searched, rounds.first_dimensions, operators)
    offsets = np.empty(count + 1, dtype=np.int32)
    for i in range(count + 1):
        offsets[i] = i
    return MatchRecord(points, searched, operators, offsets, offsets, x.warp, x.radius, x.key)


@kernel
def compare_many(
    query: Float32s,
    others: Bytes,
    ends: Ints,
    form: int,
    rounds: SearchRounds,
    scores: Floats,
    rotation: Float32s,
) -> None:
    """Write the scores of one shape with each of c others, the same whichever of two is the query.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.kernels.match_record`.
    others : uint8, shape (l_1 + ... + l_c,)
        The bytes of the others, one shape after another, each a multiple of four.
    ends : int64, shape (c,)
        The end of each shape in `others`.
    form : int
        `MATCH_RECORD` or `COARSE_SAMPLES`.
    rounds : SearchRounds
        With coarse samples, without final rounds.
    scores : float64, shape (c, 3)
        Written: CC, SSD and sim for match records; of coarse samples CC alone, -2 without a sample.
    rotation : float32, shape (b k, b k)
        Written: the map of the last pair, from the shape that comes first (`precedes`) to the second.
    """
    x = decoded(query)
    columns = x.points.shape[1]
    for start in range(0, len(ends), PAIRS_TOGETHER):
        # An empty list whose type the compiler can tell.
        pairs = [pair_of(x, x) for _ in range(0)]
        places = np.empty(PAIRS_TOGETHER, dtype=np.int64)
        for i in range(start, min(start + PAIRS_TOGETHER, len(ends))):
            # The other shape, in whichever form it is held.
            data = others[ends[i - 1] if i else 0 : ends[i]]
            y = decoded(data.view(np.float32)) if form == MATCH_RECORD else record_of_samples(data, x, rounds)
            scores[i, 0] = -2.0
            if len(y.points) == 0:
                continue
            order = precedes(x, y) if form == MATCH_RECORD else 1
            # A shape with itself: a search might find a symmetry. A domain that is one point counts 0.
            if order == 0:
                rotation[:] = 0.0
                for c in range(columns):
                    rotation[c, c] = 1.0
                scores[i, 0] = (x.radius > 0.0).mean()
                scores[i, 1] = 0.0
                scores[i, 2] = 1.0
                continue
            places[len(pairs)] = i
            pairs.append(pair_of(x, y) if order > 0 else pair_of(y, x))
        # The maps between both, in their order, and the scores of the pairs under them.
        count = len(pairs)
        if count == 0:
            continue
        rotations, correlations = np.zeros((count, columns, columns), dtype=np.float32), np.empty(count)
        fit_maps(pairs, rounds, rotations, correlations)
        for number in range(count):
            place = places[number]
            scores[place, 0] = correlations[number]
            if form == MATCH_RECORD:
                score_pairs(pairs[number], rotations[number], rounds.effective, scores[place])
        if places[count - 1] == len(ends) - 1:
            copy_matrix(rotations[count - 1], rotation)
