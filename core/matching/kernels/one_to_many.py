"""One shape matched with many others, in each of the three forms in which others are held.

Match records are matched in full. Quantised points have flat splines in place of those of a match record, and
coarse samples have none: both give an approximate CC.
"""

import math

import numpy as np

from core.arrays import Bytes, Float32s, Floats, Int16s, Int32s, Ints
from core.matching.kernels.match_record import ONE, MatchRecord, decoded, precedes, searched_columns
from core.matching.kernels.pair_matching import fit_map, score_pairs
from core.matching.kernels.spline_search import SearchRounds
from core.numerics.compilation import kernel

MATCH_RECORD, POINTS, COARSE_SAMPLES = 0, 1, 2
"""The form of the others: encoded match records, quantised points (`core.matching.quantised_points`), or
coarse samples (`core.ranking.reranking`)."""

NEW_DIRECTION = 1e-6
"""The least norm of a new direction, over the norm of its coordinate, that is more than rounding."""

EXPONENT, LARGE = 0x7F800000, 0x71800000
"""The bits of a float32 number's exponent, and those of 2^100: larger units and samples are refused."""


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
                        whole = np.rint(projection[i, column] * np.float32(ONE))
                        operators[block, c + 1 - first, i, column] = np.int16(min(max(whole, -ONE), ONE))


@kernel
def sorted_regions(regions: Int32s, offsets: Int32s, members: Int32s) -> None:
    """Write the points of each sample's region.

    Parameters
    ----------
    regions : int32, shape (d,)
        The sample nearest to each point, at least 0.
    offsets : int32, shape (m + 1,)
        Written: sample i's region is `members[offsets[i]:offsets[i + 1]]`.
    members : int32, shape (d,)
        Written.
    """
    # A counting sort: sizes of the regions, where they begin, and then each point to its place.
    m = len(offsets) - 1
    offsets[:] = 0
    for i in range(len(regions)):
        offsets[regions[i] + 1] += 1
    for i in range(m):
        offsets[i + 1] += offsets[i]
    following = offsets.copy()
    for i in range(len(regions)):
        members[following[regions[i]]] = i
        following[regions[i]] += 1


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
    # The samples: whole numbers over their units, or floats where there are no other points.
    whole = samples.view(np.int16)
    bits = samples[: len(samples) // 4 * 4].view(np.int32)
    floats = bits.view(np.float32)
    for i in range(m):
        regions[i] = i
        for c in range(columns):
            number = i * columns + c
            if d > m:
                points[i, c] = np.float32(whole[number]) * units[c]
            elif (bits[number] & EXPONENT) >= LARGE:
                return nothing
            else:
                points[i, c] = floats[number]
    for i in range(d - m):
        region = np.int32(near[i])
        if region >= m:
            return nothing
        regions[m + i] = region
        for c in range(columns):
            offset = np.float32(offsets[i * columns + c]) * units[columns + c]
            points[m + i, c] = points[region, c] + offset
    return points, regions


@kernel
def record_of_points(data: Bytes, x: MatchRecord, rounds: SearchRounds) -> MatchRecord:
    """Return a match record with flat splines, and with the warp, radius and key of x, which no map reads.

    Its points are none if `points_of` finds none.
    """
    domains, dimensions, _ = x.searched.shape
    columns = x.points.shape[1]
    points, regions = points_of(data, columns)
    # The regions are those of the samples 0 to n - 1.
    n = 0
    for i in range(len(regions)):
        n = max(n, int(regions[i]) + 1)
    offsets = np.empty(n + 1, dtype=np.int32)
    members = np.empty(len(regions), dtype=np.int32)
    sorted_regions(regions, offsets, members)
    # The first samples, with splines made from them.
    samples = min(rounds.search_samples, n, len(points))
    searched = searched_columns(points, domains, dimensions, samples)
    stages = dimensions - rounds.first_dimensions + 1
    operators = np.empty((domains, stages, samples, samples), dtype=np.int16)
    if samples > 0:
        flat_splines(searched, rounds.first_dimensions, operators)
    return MatchRecord(points, searched, operators, offsets, members, x.warp, x.radius, x.key)


@kernel
def record_of_samples(data: Bytes, x: MatchRecord) -> MatchRecord:
    """Return a match record without splines or regions, for a search from the samples of x alone."""
    domains, dimensions, _ = x.searched.shape
    columns = x.points.shape[1]
    count = int(data[:4].view(np.int32)[0])
    start = 4 + 4 * columns
    points = dequantised_points(data[start : start + count * columns], data[4:start].view(np.float32))
    searched = searched_columns(points, domains, dimensions, count)
    offsets = np.empty(count + 1, dtype=np.int32)
    for i in range(count + 1):
        offsets[i] = i
    return MatchRecord(points, searched, x.operators, offsets, offsets, x.warp, x.radius, x.key)


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
        `MATCH_RECORD`, `POINTS` or `COARSE_SAMPLES`.
    rounds : SearchRounds
        With coarse samples, of one side and without final rounds.
    scores : float64, shape (c, 3)
        Written: CC, SSD and sim for match records; of other forms CC alone, -2 if the bytes are not those of
        a shape with a sample.
    rotation : float32, shape (b k, b k)
        Written: the map of the last pair, from the shape that comes first (`precedes`) to the second.
    """
    x = decoded(query)
    columns = x.points.shape[1]
    for i in range(len(ends)):
        # The other shape, in whichever form it is held.
        data = others[ends[i - 1] if i else 0 : ends[i]]
        if form == MATCH_RECORD:
            y = decoded(data.view(np.float32))
        elif form == POINTS:
            y = record_of_points(data, x, rounds)
        else:
            y = record_of_samples(data, x)
        scores[i, 0] = -2.0
        if len(y.points) == 0:
            continue
        order = precedes(x, y) if form == MATCH_RECORD else 1
        rotation[:] = 0.0
        # A shape with itself: a search might find one of its symmetries. A domain that is one point counts 0.
        if order == 0:
            for c in range(columns):
                rotation[c, c] = 1.0
            scores[i, 0] = (x.radius > 0.0).mean()
            scores[i, 1] = 0.0
            scores[i, 2] = 1.0
            continue
        # The map between both, in their order, and the scores of the pairs under it.
        first = x if order > 0 else y
        second = y if order > 0 else x
        m = len(first.offsets) - 1
        n = len(second.offsets) - 1
        forward = np.empty(m, dtype=np.int32)
        backward = np.empty(n, dtype=np.int32)
        partners = np.empty((m if rounds.final_rounds else 0, columns), dtype=np.float32)
        sources = np.empty((n if rounds.final_rounds else 0, columns), dtype=np.float32)
        scores[i, 0] = fit_map(first, second, rounds, forward, backward, partners, sources, rotation)
        if form == MATCH_RECORD:
            score_pairs(
                first, second, forward, backward, partners, sources, rotation, rounds.effective, scores[i]
            )
