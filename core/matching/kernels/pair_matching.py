"""Two shapes matched: maps found by search and refined by nearest neighbours both ways, and pairs scored."""

import math
from typing import NamedTuple

import numpy as np

from core.arrays import Float32s, Floats, Int32s
from core.matching.kernels.match_record import MatchRecord
from core.matching.kernels.nearest_neighbours import (
    columns_of,
    compact_rows,
    copy_padded,
    cross_covariance,
    cross_covariance_both_ways,
    gather,
    mapped,
    nearest_both_ways,
    nearest_member,
    number_bits,
    padded_rows,
    padded_width,
)
from core.matching.kernels.procrustes import EXACT, ROUGH, fit_rotations
from core.matching.kernels.simd import SIMD_WIDTH, entry, load, store, symmetric_product
from core.matching.kernels.spline_search import SearchRounds, search_pairs
from core.numerics.compilation import kernel


class Pair(NamedTuple):
    """Two shapes, their samples in rows of whole vectors, and the pairs of their samples.

    Attributes
    ----------
    x, y : MatchRecord
        Of m and n samples.
    samples_of_x, samples_of_y : float32, shapes (m, b w) and (n, b w)
    forward : int32, shape (m,)
        The sample of y that each of x is paired with.
    backward : int32, shape (n,)
        The sample of x that each of y is paired with.
    partners : float32, shape (m, b w)
        The points of y that are partners of the samples of x.
    sources : float32, shape (n, b w)
        The points of x that are partners of the samples of y.
    """

    x: MatchRecord
    y: MatchRecord
    samples_of_x: Float32s
    samples_of_y: Float32s
    forward: Int32s
    backward: Int32s
    partners: Float32s
    sources: Float32s


@kernel
def pair_of(x: MatchRecord, y: MatchRecord) -> Pair:
    """Return two shapes whose samples are not paired yet."""
    m, n, domains = len(x.offsets) - 1, len(y.offsets) - 1, x.searched.shape[0]
    samples_of_x, samples_of_y = padded_rows(x.points, m, domains), padded_rows(y.points, n, domains)
    forward, backward = np.empty(m, dtype=np.int32), np.empty(n, dtype=np.int32)
    partners, sources = np.empty_like(samples_of_x), np.empty_like(samples_of_y)
    return Pair(x, y, samples_of_x, samples_of_y, forward, backward, partners, sources)


@kernel
def pair_nearest(
    x: Float32s,
    y: Float32s,
    targets: Float32s,
    rotations: Float32s,
    covariances: Float32s,
    first: Float32s,
    second: Float32s,
    forward: Int32s,
    backward: Int32s,
) -> None:
    """Pair nearest neighbours both ways under each of r maps, and write the sums that `fit_rotations` reads.

    Parameters
    ----------
    x : float32, shape (m, b w)
        Of `core.matching.kernels.nearest_neighbours.padded_rows`.
    y : float32, shape (n, b w)
    targets : float32, shape (b k, at least n)
        y by columns.
    rotations : float32, shape (r, b k, b k)
    covariances : float32, shape (r, b, k, k)
        Written.
    first, second : float32, shape (r, b)
        Written.
    forward : int32, shape (m,)
        Written: the partner of each of x under the last map.
    backward : int32, shape (n,)
        Written: the partner of each of y.
    """
    count, domains, k, _ = covariances.shape
    limit = number_bits(max(len(x), len(y)))
    for which in range(count):
        rotated = compact_rows(mapped(x, rotations[which], domains), domains, k)
        nearest_both_ways(rotated, targets, limit, forward, backward)
        cross_covariance_both_ways(x, y, forward, backward, covariances[which], first[which], second[which])


@kernel
def refine_maps(
    x: Float32s,
    y: Float32s,
    domains: int,
    steps: Float32s,
    rotations: Float32s,
    scores: Floats,
    forward: Int32s,
    backward: Int32s,
) -> None:
    """Pair nearest neighbours both ways under each of r maps, and fit the map to them again.

    Parameters
    ----------
    x : float32, shape (m, b k)
    y : float32, shape (n, b k)
    domains : int
        b.
    steps : float32, shape (p, 3)
        Of `core.matching.kernels.procrustes.nearest_rotations`.
    rotations : float32, shape (r, b k, b k)
        Read, and written where domains meet themselves.
    scores : float64, shape (r,)
        Written: correlations of the m + n pairs after the maps.
    forward : int32, shape (m,)
        Written: the partner of each of x under the last map, before the fit.
    backward : int32, shape (n,)
        Written: the partner of each of y.
    """
    count, columns, _ = rotations.shape
    k = columns // domains
    covariances = np.empty((count, domains, k, k), dtype=np.float32)
    first, second = np.empty((count, domains), dtype=np.float32), np.empty((count, domains), dtype=np.float32)
    rows_of_x, rows_of_y = padded_rows(x, len(x), domains), padded_rows(y, len(y), domains)
    targets = columns_of(y, len(y))
    pair_nearest(rows_of_x, rows_of_y, targets, rotations, covariances, first, second, forward, backward)
    fit_rotations(covariances, first, second, steps, rotations, scores)


@kernel
def fit_maps(pairs: list[Pair], rounds: SearchRounds, rotations: Float32s, scores: Floats) -> None:
    """Write the maps between p pairs of shapes, and the pairs of their samples under them.

    The maps that the searches find are refined by nearest neighbours both ways, first on few samples and for
    a few maps, then on all samples for the best. Last each sample's partner moves to the nearest of the
    embedded points in its partner's region: two meshes of one shape have their samples at different places,
    so even the best pairs of samples lie half a sample's spacing apart.

    The pairs go through each step together, since `fit_rotations` fits several maps in the time of one.

    Parameters
    ----------
    pairs : list of p Pair
        `forward`, `backward`, `partners` and `sources` are written. `warp`, `radius` and `key` of the shapes
        are not read.
    rounds : SearchRounds
        Without `final_rounds` the maps are those of the first samples, and `partners` and `sources` are not
        written.
    rotations : float32, shape (p, b k, b k)
        Zeros; written where domains meet themselves: x.points @ rotation lies on y.points.
    scores : float64, shape (p,)
        Written: CC of the pairs, the mean over the domains.
    """
    domains, columns = pairs[0].x.searched.shape[0], pairs[0].x.points.shape[1]
    k, several = columns // domains, len(pairs)

    # A map for each search.
    count = rounds.sides * domains
    maps, correlations = (
        np.zeros((several * count, columns, columns), dtype=np.float32),
        np.empty(several * count),
    )
    covariances = np.empty((several * count, domains, k, k), dtype=np.float32)
    first = np.empty((several * count, domains), dtype=np.float32)
    second = np.empty((several * count, domains), dtype=np.float32)
    for number in range(several):
        own = slice(number * count, number * count + count)
        pair = pairs[number]
        search_pairs(pair.x, pair.y, rounds, covariances[own], first[own], second[own])
    fit_rotations(covariances, first, second, ROUGH, maps, correlations)

    # Each refined once on the first samples.
    _pair_first(pairs, rounds.align_samples, count, maps, covariances, first, second)
    fit_rotations(covariances, first, second, ROUGH, maps, correlations)

    # The best few refined further; the best of them is kept.
    kept = min(rounds.kept_maps, count)
    best = np.empty((several * kept, columns, columns), dtype=np.float32)
    best_correlations = np.empty(len(best))
    for place in range(several * kept):
        start = place // kept * count
        which = start + np.argmax(correlations[start : start + count])
        copy_matrix(maps[which], best[place])
        best_correlations[place] = correlations[which]
        correlations[which] = -3.0
    covariances, first, second = covariances[: len(best)], first[: len(best)], second[: len(best)]
    for _ in range(rounds.align_rounds):
        _pair_first(pairs, rounds.align_samples, kept, best, covariances, first, second)
        fit_rotations(covariances, first, second, ROUGH, best, best_correlations)
    for number in range(several):
        which = number * kept + np.argmax(best_correlations[number * kept : number * kept + kept])
        copy_matrix(best[which], rotations[number])
        scores[number] = best_correlations[which]
    if rounds.final_rounds == 0:
        return

    # Refined on all samples.
    covariances, first, second = covariances[:several], first[:several], second[:several]
    for _ in range(rounds.final_rounds):
        for number in range(several):
            pair, own = pairs[number], slice(number, number + 1)
            pair_nearest(
                pair.samples_of_x,
                pair.samples_of_y,
                columns_of(pair.y.points, len(pair.backward)),
                rotations[own],
                covariances[own],
                first[own],
                second[own],
                pair.forward,
                pair.backward,
            )
        fit_rotations(covariances, first, second, EXACT, rotations, scores)
    for number in range(several):
        pair = pairs[number]
        gather(pair.samples_of_y, pair.forward, pair.partners)
        gather(pair.samples_of_x, pair.backward, pair.sources)

    # Partners moved within their regions, and the maps fitted to them.
    for _ in range(rounds.slides):
        for number in range(several):
            pair = pairs[number]
            there, back = rotations[number], np.ascontiguousarray(rotations[number].T)
            _slide(pair.samples_of_x, there, pair.y, pair.forward, domains, pair.partners)
            _slide(pair.samples_of_y, back, pair.x, pair.backward, domains, pair.sources)
            cross_covariance(
                pair.samples_of_x,
                pair.partners,
                pair.sources,
                pair.samples_of_y,
                covariances[number],
                first[number],
                second[number],
            )
        fit_rotations(covariances, first, second, EXACT, rotations, scores)


@kernel
def copy_matrix(numbers: Float32s, out: Float32s) -> None:
    """Write a matrix, number by number: an assigned slice costs a function call, and long to compile."""
    for i in range(len(numbers)):
        for j in range(numbers.shape[1]):
            out[i, j] = numbers[i, j]


@kernel
def _pair_first(
    pairs: list[Pair],
    samples: int,
    count: int,
    maps: Float32s,
    covariances: Float32s,
    first: Float32s,
    second: Float32s,
) -> None:
    """Call `pair_nearest` for the first samples of each pair of shapes, under its `count` maps."""
    for number in range(len(pairs)):
        pair, own = pairs[number], slice(number * count, number * count + count)
        m, n = min(samples, len(pair.forward)), min(samples, len(pair.backward))
        pair_nearest(
            pair.samples_of_x[:m],
            pair.samples_of_y[:n],
            columns_of(pair.y.points, n),
            maps[own],
            covariances[own],
            first[own],
            second[own],
            pair.forward[:m],
            pair.backward[:n],
        )


@kernel
def _slide(
    samples: Float32s,
    rotation: Float32s,
    shape: MatchRecord,
    matches: Int32s,
    domains: int,
    partners: Float32s,
) -> None:
    """Write the points of a shape nearest to samples under a map, each in the region of its match."""
    k = shape.points.shape[1] // domains
    ends = compact_rows(mapped(samples, rotation, domains), domains, k)
    for i in range(len(matches)):
        start, stop = shape.offsets[matches[i]], shape.offsets[matches[i] + 1]
        row = nearest_member(shape.points, shape.members, start, stop, ends, i)
        copy_padded(shape.points, row, partners, i, domains, k)


@kernel
def _effective_share(
    lower: Float32s, misses: Float32s, matches: Int32s, low: int, k: int, gamma: float, count: int
) -> float:
    """Return the number of distinct matches that the softer spline brings a point within gamma of, a share.

    The share is of min(m, count). The spline reproduces affine maps of the samples, so it moves the partners
    by as much as it moves their differences from the mapped samples. These are shorter than the partners: the
    rounding of the spline matters less.

    Parameters
    ----------
    lower : float32, shape (m, m)
        A matrix of `MatchRecord.warp`.
    misses : float32, shape (m, b w)
        Partners less samples, both after the map; their domain has the k columns from `low` on, and a column
        of ones after them.
    matches : int32, shape (m,)
        The samples that the partners belong to, each less than `count`.
    low, k : int
    gamma : float
    count : int
    """
    m = len(matches)
    moved = np.empty((m, padded_width(k)), dtype=np.float32)
    symmetric_product(lower, misses, low, moved)
    # A row of the spline sums to 1, so its diagonal follows from the sum of its other entries.
    limit = np.float32(gamma * gamma)
    taken = np.zeros(count, dtype=np.int64)
    width, columns = moved.shape[1], misses.shape[1]
    for i in range(m):
        sums = entry(moved, i * width + k, SIMD_WIDTH)
        for c in range(0, k, SIMD_WIDTH):
            place = i * width + c
            change = load(moved, place, SIMD_WIDTH) - sums * load(misses, i * columns + low + c, SIMD_WIDTH)
            store(change * change, moved, place)
    for i in range(m):
        square = np.float32(0.0)
        for c in range(k):
            square += moved[i, c]
        taken[matches[i]] |= np.int64(square <= limit)
    return float(taken.sum()) / min(m, count)


@kernel
def _add_pairs(
    ends: Float32s,
    targets: Float32s,
    misses: Float32s,
    sums: Float32s,
    products: Float32s,
    differences: Float32s,
) -> None:
    """Add the sums of paired rows, shape (p, b w), to those of each column, and write their differences."""
    count, columns = ends.shape
    for c in range(0, columns, SIMD_WIDTH):
        of_ends, of_targets = load(sums, c, SIMD_WIDTH), load(sums, columns + c, SIMD_WIDTH)
        squares_of_ends, squares_of_targets = (
            load(products, c, SIMD_WIDTH),
            load(products, columns + c, SIMD_WIDTH),
        )
        across = load(products, 2 * columns + c, SIMD_WIDTH)
        squares = load(differences, c, SIMD_WIDTH)
        for i in range(count):
            place = i * columns + c
            end, target = load(ends, place, SIMD_WIDTH), load(targets, place, SIMD_WIDTH)
            miss = target - end
            store(miss, misses, place)
            of_ends = of_ends + end
            of_targets = of_targets + target
            squares_of_ends = squares_of_ends + end * end
            squares_of_targets = squares_of_targets + target * target
            across = across + end * target
            squares = squares + miss * miss
        store(of_ends, sums, c)
        store(of_targets, sums, columns + c)
        store(squares_of_ends, products, c)
        store(squares_of_targets, products, columns + c)
        store(across, products, 2 * columns + c)
        store(squares, differences, c)


@kernel
def score_pairs(pair: Pair, rotation: Float32s, effective: float, scores: Floats) -> None:
    """Write CC, SSD and sim of two shapes whose samples are paired: Eqs. 18-20, means over the domains.

    Parameters
    ----------
    pair : Pair
    rotation : float32, shape (b k, b k)
    effective : float
        gamma over the mean radius of the two clouds.
    scores : float64, shape (3,)
        Written: CC in [-1, 1], SSD >= 0, sim in [0, 1].
    """
    x, y, forward, backward = pair.x, pair.y, pair.forward, pair.backward
    m = len(forward)
    n = len(backward)
    domains = len(x.radius)
    k = x.points.shape[1] // domains
    columns = pair.partners.shape[1]
    width = columns // domains
    # Both sides of the pairs from each shape, the side of x after the map.
    ends = mapped(pair.samples_of_x, rotation, domains), mapped(pair.sources, rotation, domains)
    targets = pair.partners, pair.samples_of_y
    misses = np.empty((m, columns), dtype=np.float32), np.empty((n, columns), dtype=np.float32)
    # Sums of each column: of both sides, of their squares and products, and of the squared differences.
    sums = np.zeros((2, columns), dtype=np.float32)
    products = np.zeros((3, columns), dtype=np.float32)
    differences = np.zeros(columns, dtype=np.float32)
    for way in range(2):
        _add_pairs(ends[way], targets[way], misses[way], sums, products, differences)
        for i in range(len(misses[way])):
            for low in range(0, columns, width):
                misses[way][i, low + k] = np.float32(1.0)
    # The scores of each domain.
    share = np.float32(1.0) / np.float32(m + n)
    scores[:] = 0.0
    for block in range(domains):
        low = block * width
        square_of_x = np.float32(0.0)
        square_of_y = np.float32(0.0)
        cross = np.float32(0.0)
        difference = np.float32(0.0)
        for c in range(low, low + k):
            square_of_x += products[0, c] - sums[0, c] * sums[0, c] * share
            square_of_y += products[1, c] - sums[1, c] * sums[1, c] * share
            cross += products[2, c] - sums[0, c] * sums[1, c] * share
            difference += differences[c]
        size = math.sqrt(max(0.0, float(square_of_x * square_of_y)))
        if size > 0.0:
            scores[0] += max(-1.0, min(1.0, float(cross) / size)) / domains
        scores[1] += math.sqrt(difference) / (m + n) / domains
        gamma = effective * 0.5 * (x.radius[block] + y.radius[block])
        scores[2] += 0.5 * _effective_share(x.warp[block], misses[0], forward, low, k, gamma, n) / domains
        scores[2] += 0.5 * _effective_share(y.warp[block], misses[1], backward, low, k, gamma, m) / domains
