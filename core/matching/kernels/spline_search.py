"""The compiled search for initial maps: a thin-plate spline of few points, iterated (Eq. 17).

`core.matching.tps_matcher.spline_search` is the reference, with one start kept. All first signs go through
one product, and inner loops are SIMD loops.
"""

import math
from typing import NamedTuple

import numpy as np

from core.arrays import Float32s, Int16s, Int32s
from core.matching.kernels.match_record import MatchRecord, dequantised
from core.matching.kernels.nearest_neighbours import cross_covariance, gather, nearest_columns, number_bits
from core.matching.kernels.procrustes import ROUGH, fit_rotation
from core.matching.kernels.simd import product
from core.numerics.compilation import kernel


class SearchRounds(NamedTuple):
    """Sizes of the search and numbers of rounds: see `core.parameters.Parameters`.

    Searches begin from both shapes (`sides` is 2), or from the first alone. `effective` is gamma over the
    mean radius of two clouds.
    """

    search_samples: int
    first_dimensions: int
    starts: int
    start_iterations: int
    step_iterations: int
    sides: int
    align_samples: int
    kept_maps: int
    align_rounds: int
    final_rounds: int
    slides: int
    effective: float


@kernel
def signless_correlation(points: Float32s, targets: Float32s, matches: Int32s, k: int) -> float:
    """Return the correlation of matched clouds in their first k columns, each with the sign that suits it.

    Parameters
    ----------
    points : float32, shape (>= k, p)
    targets : float32, shape (>= k, n)
    matches : int32, shape (p,)
        A target for each point.
    k : int
    """
    p = points.shape[1]
    cross = np.float32(0.0)
    first = np.float32(0.0)
    second = np.float32(0.0)
    for c in range(k):
        # Sums over the pairs of one column.
        x_sum = np.float32(0.0)
        y_sum = np.float32(0.0)
        xy = np.float32(0.0)
        xx = np.float32(0.0)
        yy = np.float32(0.0)
        for i in range(p):
            x = points[c, i]
            y = targets[c, matches[i]]
            x_sum += x
            y_sum += y
            xy += x * y
            xx += x * x
            yy += y * y
        # Centred; the sign that suits the column makes its part of the cross-sum positive.
        cross += abs(xy - x_sum * y_sum / p)
        first += xx - x_sum * x_sum / p
        second += yy - y_sum * y_sum / p
    size = math.sqrt(max(np.float32(0.0), first * second))
    return float(cross / size) if size > 0.0 else 0.0


@kernel
def spline_search(
    points: Float32s,
    targets: Float32s,
    operators: Int16s,
    first: int,
    starts: int,
    start_rounds: int,
    step_rounds: int,
    limit: int,
    matches: Int32s,
) -> None:
    """Write the target of each point, as the best start finds it (Eq. 17).

    Parameters
    ----------
    points : float32, shape (k, s)
        By columns: row c holds coordinate c of all points.
    targets : float32, shape (k, n)
    operators : int16, shape (k - first + 1, s, s)
        Symmetric: `core.matching.thin_plate_spline.spline_operators` of the points, over `match_record.ONE`.
    first : int
        Dimensions of the first stage.
    starts : int
        2^first sign changes of the first coordinates, or 1 for none.
    start_rounds, step_rounds : int
        Spline rounds of every start, and of the best one after each dimension added.
    limit : int
        See `nearest_columns`.
    matches : int32, shape (s,)
    """
    k_all, s = points.shape
    # The first coordinates with all signs side by side, and the target nearest to each.
    several = starts * s
    stacked = np.empty((first, several), dtype=np.float32)
    nearest = np.empty(several, dtype=np.int32)
    for c in range(first):
        for start in range(starts):
            sign = np.float32(-1.0) if (start >> c) & 1 else np.float32(1.0)
            for i in range(s):
                stacked[c, start * s + i] = sign * points[c, i]
    nearest_columns(stacked, targets, first, limit, nearest)
    # Rounds of the spline in the first dimensions, for all starts in one product.
    matched = np.empty((max(first * starts, k_all), s), dtype=np.float32)
    warped = np.empty((len(matched), s), dtype=np.float32)
    # Rounds of all starts: the spline to the targets found, and the targets nearest to its values.
    for _ in range(start_rounds):
        for c in range(first):
            for start in range(starts):
                for i in range(s):
                    matched[c * starts + start, i] = targets[c, nearest[start * s + i]]
        product(matched[: first * starts], dequantised(operators[0]), warped[: first * starts])
        nearest_columns(warped[: first * starts].reshape(first, several), targets, first, limit, nearest)
    # The start of the best correlation.
    best = 0
    score = -2.0
    for start in range(starts):
        correlation = signless_correlation(points, targets, nearest[start * s : start * s + s], first)
        if correlation > score:
            score = correlation
            best = start
    for i in range(s):
        matches[i] = nearest[best * s + i]
    # The best start in one more dimension at a time.
    for k in range(first + 1, k_all + 1):
        operator = dequantised(operators[k - first])
        for _ in range(step_rounds):
            for c in range(k):
                for i in range(s):
                    matched[c, i] = targets[c, matches[i]]
            product(matched[:k], operator, warped[:k])
            nearest_columns(warped[:k], targets, k, limit, matches)


@kernel
def search_maps(
    x: MatchRecord, y: MatchRecord, rounds: SearchRounds, rotations: Float32s, scores: Float32s
) -> None:
    """Write orthogonal maps to begin from: one for each search, in each domain and from each side.

    The pairs found in one domain determine the map in all.

    Parameters
    ----------
    x, y : MatchRecord
    rounds : SearchRounds
    rotations : float32, shape (sides b, b k, b k)
        Zeros; written where blocks meet themselves.
    scores : float32, shape (sides b,)
        Written: their correlations.
    """
    blocks = x.searched.shape[0]
    columns = x.points.shape[1]
    covariance = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    none = np.empty((0, columns), dtype=np.float32)
    for search in range(rounds.sides * blocks):
        # Pairs by the spline search in one domain, from one of the two shapes.
        domain = search // rounds.sides
        from_x = search % rounds.sides == 0
        source = x if from_x else y
        target = y if from_x else x
        s = source.searched.shape[2]
        matches = np.empty(s, dtype=np.int32)
        spline_search(
            source.searched[domain],
            target.searched[domain],
            source.operators[domain],
            rounds.first_dimensions,
            rounds.starts,
            rounds.start_iterations,
            rounds.step_iterations,
            number_bits(target.searched.shape[2]),
            matches,
        )
        # The map of all domains that fits these pairs, from x to y.
        partners = np.empty((s, columns), dtype=np.float32)
        gather(target.points, matches, partners)
        points = source.points[:s]
        if from_x:
            cross_covariance(points, partners, none, none, covariance, first, second)
        else:
            cross_covariance(partners, points, none, none, covariance, first, second)
        scores[search] = fit_rotation(covariance, first, second, ROUGH, rotations[search])
