"""Two shapes matched: maps found by search and refined by nearest neighbours both ways, and pairs scored."""

import math

import numpy as np

from core.arrays import Float32s, Floats, Int8s, Int32s
from core.matching.kernels.match_record import MatchRecord, lower_triangle
from core.matching.kernels.nearest_neighbours import (
    cross_covariance,
    cross_covariance_both_ways,
    gather,
    nearest_both_ways,
    nearest_member,
    number_bits,
)
from core.matching.kernels.procrustes import EXACT, ROUGH, fit_rotation
from core.matching.kernels.simd import SIMD_WIDTH, product, symmetric_product
from core.matching.kernels.spline_search import SearchRounds, search_maps
from core.numerics.compilation import kernel


@kernel
def refine_map(
    x: Float32s,
    y: Float32s,
    targets: Float32s,
    blocks: int,
    steps: Float32s,
    rotation: Float32s,
    forward: Int32s,
    backward: Int32s,
) -> float:
    """Pair nearest neighbours both ways under a map, and fit the map to them again.

    Parameters
    ----------
    x : float32, shape (m, b k)
    y : float32, shape (n, b k)
    targets : float32, shape (b k, n)
        y by columns.
    blocks : int
        b.
    steps : float32, shape (n, 3)
        Of `core.matching.kernels.procrustes.nearest_rotation`.
    rotation : float32, shape (b k, b k)
        Read, and written where blocks meet themselves.
    forward : int32, shape (m,)
        Written: the partner of each of x, before the fit.
    backward : int32, shape (n,)
        Written: the partner of each of y.

    Returns
    -------
    float
        Correlation of the m + n pairs after the map.
    """
    # Pairs under the map, and the map that fits them.
    m, columns = x.shape
    covariance = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    rotated = np.empty((m, columns), dtype=np.float32)
    product(x, rotation, rotated)
    nearest_both_ways(rotated, targets, number_bits(max(m, len(y))), forward, backward)
    cross_covariance_both_ways(x, y, forward, backward, covariance, first, second)
    return fit_rotation(covariance, first, second, steps, rotation)


@kernel
def fit_map(
    x: MatchRecord,
    y: MatchRecord,
    rounds: SearchRounds,
    forward: Int32s,
    backward: Int32s,
    partners: Float32s,
    sources: Float32s,
    rotation: Float32s,
) -> float:
    """Write the map between two shapes, and the pairs under it.

    The maps that the searches find are refined by nearest neighbours both ways, first on few samples and for
    a few maps, then on all samples for the best. Last each sample's partner moves to the nearest of the
    embedded points in its partner's region: two meshes of one shape have their samples at different places,
    so even the best pairs of samples lie half a sample's spacing apart.

    Parameters
    ----------
    x, y : MatchRecord
        Of m and n samples. `warp`, `radius` and `key` are not read.
    rounds : SearchRounds
        Without `final_rounds` the map is that of the first samples, and there are no pairs: nothing but it is
        written.
    forward : int32, shape (m,)
        Written: the sample of y that each of x is paired with.
    backward : int32, shape (n,)
        Written: the sample of x that each of y is paired with.
    partners : float32, shape (m, b k)
        Written: the points of y that are partners of the samples of x.
    sources : float32, shape (n, b k)
        Written: the points of x that are partners of the samples of y.
    rotation : float32, shape (b k, b k)
        Written: x.points @ rotation lies on y.points; 0 outside the blocks.

    Returns
    -------
    float
        CC of the pairs, the mean over the domains.
    """
    m = len(forward)
    n = len(backward)
    blocks = x.searched.shape[0]
    columns = x.points.shape[1]

    # A map for each search.
    count = rounds.sides * blocks
    rotations = np.zeros((count, columns, columns), dtype=np.float32)
    scores = np.zeros(count, dtype=np.float32)
    search_maps(x, y, rounds, rotations, scores)

    # Each refined once on the first samples.
    first_of_x = x.points[: min(rounds.align_samples, m)]
    first_of_y = y.points[: min(rounds.align_samples, n)]
    targets = np.ascontiguousarray(first_of_y.T)
    for search in range(count):
        scores[search] = refine_map(
            first_of_x, first_of_y, targets, blocks, ROUGH, rotations[search], forward, backward
        )

    # The best few refined further; the best of them is kept.
    score = -2.0
    for _ in range(min(rounds.kept_maps, count)):
        candidate = np.argmax(scores)
        refined = scores[candidate]
        for _ in range(rounds.align_rounds):
            refined = refine_map(
                first_of_x, first_of_y, targets, blocks, ROUGH, rotations[candidate], forward, backward
            )
        scores[candidate] = -3.0
        if refined > score:
            score = refined
            for c in range(columns):
                for d in range(columns):
                    rotation[c, d] = rotations[candidate, c, d]
    if rounds.final_rounds == 0:
        return score

    # Refined on all samples.
    samples_of_x = x.points[:m]
    samples_of_y = y.points[:n]
    targets = np.ascontiguousarray(samples_of_y.T)
    for _ in range(rounds.final_rounds):
        score = refine_map(samples_of_x, samples_of_y, targets, blocks, EXACT, rotation, forward, backward)
    gather(samples_of_y, forward, partners)
    gather(samples_of_x, backward, sources)

    # Partners moved within their regions, and the map fitted to them.
    covariance = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    ends = np.empty((m, columns), dtype=np.float32)
    starts = np.empty((n, columns), dtype=np.float32)
    for _ in range(rounds.slides):
        product(samples_of_x, rotation, ends)
        product(samples_of_y, np.ascontiguousarray(rotation.T), starts)
        for i in range(m):
            region = forward[i]
            row = nearest_member(y.points, y.members, y.offsets[region], y.offsets[region + 1], ends, i)
            for c in range(columns):
                partners[i, c] = y.points[row, c]
        for j in range(n):
            region = backward[j]
            row = nearest_member(x.points, x.members, x.offsets[region], x.offsets[region + 1], starts, j)
            for c in range(columns):
                sources[j, c] = x.points[row, c]
        cross_covariance(samples_of_x, partners, sources, samples_of_y, covariance, first, second)
        score = fit_rotation(covariance, first, second, EXACT, rotation)
    return score


@kernel
def _effective_share(
    warp: Int8s, misses: Float32s, matches: Int32s, low: int, k: int, gamma: float, count: int
) -> float:
    """Return the number of distinct matches that the softer spline brings a point within gamma of, a share.

    The share is of min(m, count). The spline reproduces affine maps of the samples, so it moves the partners
    by as much as it moves their differences from the mapped samples. These are shorter than the partners: the
    rounding of the spline matters less.

    Parameters
    ----------
    warp : int8, shape (m (m - 1) / 2,)
        A row of `MatchRecord.warp`.
    misses : float32, shape (m, >= low + k)
        Partners less samples, both after the map; their domain has the k columns from `low` on.
    matches : int32, shape (m,)
        The samples that the partners belong to, each less than `count`.
    low, k : int
    gamma : float
    count : int
    """
    m = len(matches)
    # The differences and a column of ones, padded with zeros to whole vectors.
    width = (k + SIMD_WIDTH) // SIMD_WIDTH * SIMD_WIDTH
    points = np.zeros((m, width), dtype=np.float32)
    for i in range(m):
        for c in range(k):
            points[i, c] = misses[i, low + c]
        points[i, k] = np.float32(1.0)
    moved = np.empty((m, width), dtype=np.float32)
    symmetric_product(lower_triangle(warp, m), points, moved)
    # A row of the spline sums to 1, so its diagonal follows from the sum of its other entries.
    limit = np.float32(gamma * gamma)
    taken = np.zeros(count, dtype=np.bool_)
    share = 0.0
    for i in range(m):
        square = np.float32(0.0)
        for c in range(k):
            square += (moved[i, c] - moved[i, k] * points[i, c]) ** 2
        if square <= limit and not taken[matches[i]]:
            taken[matches[i]] = True
            share += 1.0
    return share / min(m, count)


@kernel
def score_pairs(
    x: MatchRecord,
    y: MatchRecord,
    forward: Int32s,
    backward: Int32s,
    partners: Float32s,
    sources: Float32s,
    rotation: Float32s,
    effective: float,
    scores: Floats,
) -> None:
    """Write CC, SSD and sim of pairs under a map: Eqs. 18-20, means over the domains.

    Parameters
    ----------
    x, y : MatchRecord
        Of m and n samples.
    forward, backward : int32, shapes (m,) and (n,)
        The sample whose region each partner lies in.
    partners, sources : float32, shapes (m, b k) and (n, b k)
        The partners of the samples of x and of those of y.
    rotation : float32, shape (b k, b k)
    effective : float
        gamma over the mean radius of the two clouds.
    scores : float64, shape (3,)
        Written: CC in [-1, 1], SSD >= 0, sim in [0, 1].
    """
    m = len(forward)
    n = len(backward)
    blocks = len(x.radius)
    columns = x.points.shape[1]
    k = columns // blocks
    # Both sides of all m + n pairs, the side of x after the map.
    ends = np.empty((m + n, columns), dtype=np.float32)
    product(x.points[:m], rotation, ends[:m])
    product(sources, rotation, ends[m:])
    targets = np.empty((m + n, columns), dtype=np.float32)
    misses = np.empty((m + n, columns), dtype=np.float32)
    for i in range(m + n):
        for c in range(columns):
            targets[i, c] = partners[i, c] if i < m else y.points[i - m, c]
            misses[i, c] = targets[i, c] - ends[i, c]
    # Sums of each column: of both sides, of their squares and products, and of the squared differences.
    sums = np.zeros((2, columns), dtype=np.float32)
    products = np.zeros((3, columns), dtype=np.float32)
    differences = np.zeros(columns, dtype=np.float32)
    for i in range(m + n):
        for c in range(columns):
            sums[0, c] += ends[i, c]
            sums[1, c] += targets[i, c]
            products[0, c] += ends[i, c] * ends[i, c]
            products[1, c] += targets[i, c] * targets[i, c]
            products[2, c] += ends[i, c] * targets[i, c]
            differences[c] += misses[i, c] * misses[i, c]
    # The scores of each domain.
    share = np.float32(1.0) / np.float32(m + n)
    scores[:] = 0.0
    for block in range(blocks):
        low = block * k
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
            scores[0] += max(-1.0, min(1.0, float(cross) / size)) / blocks
        scores[1] += math.sqrt(difference) / (m + n) / blocks
        gamma = effective * 0.5 * (x.radius[block] + y.radius[block])
        scores[2] += 0.5 * _effective_share(x.warp[block], misses[:m], forward, low, k, gamma, n) / blocks
        scores[2] += 0.5 * _effective_share(y.warp[block], misses[m:], backward, low, k, gamma, m) / blocks
