"""The compiled search for initial maps: a thin-plate spline of few points, iterated (Eq. 17).

`core.matching.tps_matcher.spline_search` is the reference, with one start kept. All first signs go through
one product, and vectors of points are compared with each target.
"""

import math
from typing import NamedTuple

import numpy as np

from core.arrays import Float32s, Floats, Int32s
from core.matching.kernels.match_record import MatchRecord
from core.matching.kernels.nearest_neighbours import (
    cross_covariance,
    gather,
    nearest_columns,
    number_bits,
    padded_rows,
)
from core.matching.kernels.procrustes import ROUGH, fit_rotations
from core.matching.kernels.simd import product, whole_vectors
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
    operators: Float32s,
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
    operators : float32, shape (k - first + 1, s, w)
        `core.matching.thin_plate_spline.spline_operators` of the points, with rows of whole vectors.
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
    width = whole_vectors(s)
    # The first coordinates with all signs side by side, padded, and the target nearest to each.
    several = starts * width
    stacked = np.zeros((first, several), dtype=np.float32)
    nearest = np.empty(several, dtype=np.int32)
    for c in range(first):
        for start in range(starts):
            sign = np.float32(-1.0) if (start >> c) & 1 else np.float32(1.0)
            for i in range(s):
                stacked[c, start * width + i] = sign * points[c, i]
    nearest_columns(stacked, targets, first, limit, nearest)
    # Rounds of all starts: the spline to the targets found, in one product, and the targets nearest to it.
    matched = np.empty((max(first * starts, k_all), width), dtype=np.float32)
    warped = np.empty((len(matched), width), dtype=np.float32)
    for _ in range(start_rounds):
        for c in range(first):
            for start in range(starts):
                for i in range(width):
                    matched[c * starts + start, i] = targets[c, nearest[start * width + i]]
        product(matched[: first * starts], operators[0], warped[: first * starts])
        nearest_columns(warped[: first * starts].reshape(first, several), targets, first, limit, nearest)
    # The start of the best correlation.
    best = 0
    score = -2.0
    for start in range(starts):
        correlation = signless_correlation(points, targets, nearest[start * width : start * width + s], first)
        if correlation > score:
            score = correlation
            best = start
    found = nearest[best * width : best * width + width].copy()
    # The best start in one more dimension at a time.
    for k in range(first + 1, k_all + 1):
        for _ in range(step_rounds):
            for c in range(k):
                for i in range(width):
                    matched[c, i] = targets[c, found[i]]
            product(matched[:k], operators[k - first], warped[:k])
            nearest_columns(warped[:k], targets, k, limit, found)
    for i in range(s):
        matches[i] = found[i]


@kernel
def search_maps(
    x: MatchRecord, y: MatchRecord, rounds: SearchRounds, rotations: Float32s, scores: Floats
) -> None:
    """Write orthogonal maps to begin from: one for each search, in each domain and from each side.

    Parameters
    ----------
    x, y : MatchRecord
    rounds : SearchRounds
    rotations : float32, shape (sides b, b k, b k)
        Zeros; written where domains meet themselves.
    scores : float64, shape (sides b,)
        Written: their correlations.
    """
    domains = x.searched.shape[0]
    count, k = rounds.sides * domains, x.points.shape[1] // domains
    covariances = np.empty((count, domains, k, k), dtype=np.float32)
    first, second = np.empty((count, domains), dtype=np.float32), np.empty((count, domains), dtype=np.float32)
    search_pairs(x, y, rounds, covariances, first, second)
    fit_rotations(covariances, first, second, ROUGH, rotations, scores)


@kernel
def search_pairs(
    x: MatchRecord,
    y: MatchRecord,
    rounds: SearchRounds,
    covariances: Float32s,
    first: Float32s,
    second: Float32s,
) -> None:
    """Search pairs in each domain and from each side, and write the sums that `fit_rotations` reads.

    The pairs found in one domain determine the map in all.

    Parameters
    ----------
    x, y : MatchRecord
    rounds : SearchRounds
    covariances : float32, shape (sides b, b, k, k)
        Written.
    first, second : float32, shape (sides b, b)
        Written.
    """
    domains, _, samples_of_x = x.searched.shape
    rows_of_x = padded_rows(x.points, samples_of_x, domains)
    rows_of_y = padded_rows(y.points, y.searched.shape[2], domains)
    none = np.empty((0, rows_of_x.shape[1]), dtype=np.float32)
    for search in range(rounds.sides * domains):
        # Pairs by the spline search in one domain, from one of the two shapes.
        domain = search // rounds.sides
        from_x = search % rounds.sides == 0
        source = x if from_x else y
        target = y if from_x else x
        matches = np.empty(source.searched.shape[2], dtype=np.int32)
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
        # The covariance of these pairs in all domains, from x to y.
        partners = np.empty((len(matches), rows_of_x.shape[1]), dtype=np.float32)
        gather(rows_of_y if from_x else rows_of_x, matches, partners)
        points, partners = (rows_of_x, partners) if from_x else (partners, rows_of_y)
        cross_covariance(points, partners, none, none, covariances[search], first[search], second[search])
