"""Two shapes matched: maps found by search, refined by nearest neighbours both ways, scored."""

import math
from typing import NamedTuple

import numpy as np

from core.arrays import Float32s, Floats, Int16s, Int32s
from core.matching.kernels.match_record import ONE, MatchRecord
from core.matching.kernels.matrix_product import product
from core.matching.kernels.nearest_neighbours import (
    closest,
    cross_covariance,
    cross_covariance_both_ways,
    gather,
    nearest_both_ways,
)
from core.matching.kernels.orthogonal_procrustes import EXACT, ROUGH, fit_rotation
from core.matching.kernels.spline_search import spline_search
from core.numerics.compilation import kernel

FINEST = 8191
"""The largest coordinate in integers, where the entries of a spline's matrix are at most `ONE`."""


class SearchRounds(NamedTuple):
    """Numbers of rounds: see `core.parameters.Parameters`.

    Searches begin from both shapes (`sides` is 2), or from the first alone.
    """

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
def lowest_bits(n: int) -> int:
    """A power of two above n, at least 128."""
    low = 128
    while low <= n:
        low *= 2
    return low


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
    scores : float32, shape (sides b,)
        Their correlations.
    """
    blocks = x.searched.shape[0]
    columns = x.points.shape[1]
    covariance = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    none = np.empty((0, columns), dtype=np.float32)
    for which in range(rounds.sides * blocks):
        domain = which // rounds.sides
        forth = which % rounds.sides == 0
        one = x if forth else y
        other = y if forth else x
        s = one.searched.shape[2]
        matches = np.empty(s, dtype=np.int32)
        spline_search(
            one.searched[domain],
            other.searched[domain],
            one.operators[domain],
            rounds.first_dimensions,
            rounds.starts,
            rounds.start_iterations,
            rounds.step_iterations,
            lowest_bits(other.searched.shape[2]),
            matches,
        )
        found = np.empty((s, columns), dtype=np.float32)
        gather(other.points, matches, found)
        if forth:
            cross_covariance(x.points[:s], found, none, none, blocks, covariance, first, second)
        else:
            cross_covariance(found, y.points[:s], none, none, blocks, covariance, first, second)
        scores[which] = fit_rotation(covariance, first, second, ROUGH, rotations[which])


@kernel
def refine_map(
    x: Float32s,
    y: Float32s,
    targets: Float32s,
    blocks: int,
    count: int,
    steps: Float32s,
    rotation: Float32s,
    there: Int32s,
    back: Int32s,
) -> float:
    """Nearest neighbours both ways under a map, and the map fitted to them again, `count` times.

    Parameters
    ----------
    x : float32, shape (m, b k)
    y : float32, shape (n, b k)
    targets : float32, shape (b k, n)
        y by columns.
    blocks, count : int
    steps : float32, shape (n, 3)
        Of `core.matching.kernels.orthogonal_procrustes.nearest_rotation`.
    rotation : float32, shape (b k, b k)
        Read, and written where blocks meet themselves.
    there : int32, shape (m,)
        Written: the partner of each of x, before the last fit.
    back : int32, shape (n,)

    Returns
    -------
    float
        Correlation of the m + n pairs after the map.
    """
    m, columns = x.shape
    n = y.shape[0]
    low = lowest_bits(max(m, n))
    covariance = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    rotated = np.empty((m, columns), dtype=np.float32)
    score = 0.0
    for _ in range(count):
        product(x, rotation, rotated)
        nearest_both_ways(rotated, targets, low, there, back)
        cross_covariance_both_ways(x, y, there, back, blocks, covariance, first, second)
        score = fit_rotation(covariance, first, second, steps, rotation)
    return score


@kernel
def best_map(x: MatchRecord, y: MatchRecord, rounds: SearchRounds, rotation: Float32s) -> float:
    """Write the best of several maps, each searched for and then refined on the first samples.

    Returns
    -------
    float
        Correlation of those samples after the map.
    """
    blocks = x.searched.shape[0]
    columns = x.points.shape[1]
    number = rounds.sides * blocks
    rotations = np.zeros((number, columns, columns), dtype=np.float32)
    scores = np.zeros(number, dtype=np.float32)
    search_maps(x, y, rounds, rotations, scores)
    some = x.points[: min(rounds.align_samples, len(x.offsets) - 1)]
    others = y.points[: min(rounds.align_samples, len(y.offsets) - 1)]
    targets = np.ascontiguousarray(others.T)
    there = np.empty(len(some), dtype=np.int32)
    back = np.empty(len(others), dtype=np.int32)
    for which in range(number):
        scores[which] = refine_map(some, others, targets, blocks, 1, ROUGH, rotations[which], there, back)
    order = np.argsort(-scores, kind="mergesort")
    best = -2.0
    for place in range(min(rounds.kept_maps, number)):
        found = rotations[order[place]]
        score = scores[order[place]]
        if rounds.align_rounds > 0:
            score = refine_map(some, others, targets, blocks, rounds.align_rounds, ROUGH, found, there, back)
        if score > best:
            best = score
            rotation[:] = found
    return best


@kernel
def _effective_share(
    warp: Int16s, targets: Float32s, matches: Int32s, low: int, k: int, gamma: float, count: int
) -> float:
    """Distinct matches that the softer spline brings a point within gamma of, over min(m, count).

    In integers: their sums may be taken in any order, and so by SIMD. A point is left as soon as some of its
    coordinates are too far away. A spline makes no vector longer, so the largest coordinate after it is at
    most the root of m times the largest before, and products stay under 2^31.
    """
    m = len(matches)
    most = np.float32(0.0)
    for i in range(m):
        for c in range(k):
            most = max(most, abs(targets[i, low + c]))
    largest = min(FINEST, math.floor(2**31 / ONE / math.sqrt(m)) - 1)
    scale = np.float32(largest) / most if most > 0.0 else np.float32(0.0)
    block = np.empty((k, m), dtype=np.int16)
    for i in range(m):
        for c in range(k):
            block[c, i] = np.int16(np.floor(targets[i, low + c] * scale + np.float32(0.5)))
    limit = np.float32((gamma * scale) ** 2)
    taken = np.zeros(count, dtype=np.bool_)
    share = 0.0
    for i in range(m):
        if taken[matches[i]]:
            continue
        square = np.float32(0.0)
        for c in range(k):
            total = np.int32(0)
            for j in range(m):
                total = np.int32(total + np.int32(np.int32(warp[i, j]) * np.int32(block[c, j])))
            step = np.float32(total) * np.float32(1.0 / ONE) - np.float32(block[c, i])
            square += step * step
            if square > limit:
                break
        if square <= limit:
            taken[matches[i]] = True
            share += 1.0
    return share / min(m, count)


@kernel
def score_pairs(
    x: MatchRecord,
    y: MatchRecord,
    there: Int32s,
    back: Int32s,
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
    there, back : int32, shapes (m,) and (n,)
        The sample whose region each one's partner lies in.
    partners, sources : float32, shapes (m, b k) and (n, b k)
        The partners of the samples of x and of those of y.
    rotation : float32, shape (b k, b k)
    effective : float
        gamma over the mean radius of the two clouds.
    scores : float64, shape (3,)
        CC in [-1, 1], SSD >= 0, sim in [0, 1].
    """
    m = len(there)
    n = len(back)
    blocks = len(x.radius)
    columns = x.points.shape[1]
    k = columns // blocks
    ends = np.empty((m, columns), dtype=np.float32)
    rotated = np.empty((n, columns), dtype=np.float32)
    product(x.points[:m], rotation, ends)
    product(sources, rotation, rotated)
    scores[:] = 0.0
    yours = y.points[:n]
    sums = np.zeros((2, columns), dtype=np.float32)
    products = np.zeros((3, columns), dtype=np.float32)
    steps = np.zeros(columns, dtype=np.float32)
    for i in range(m):
        for c in range(columns):
            sums[0, c] += ends[i, c]
            sums[1, c] += partners[i, c]
            products[0, c] += ends[i, c] * ends[i, c]
            products[1, c] += partners[i, c] * partners[i, c]
            products[2, c] += ends[i, c] * partners[i, c]
            steps[c] += (ends[i, c] - partners[i, c]) ** 2
    for j in range(n):
        for c in range(columns):
            sums[0, c] += rotated[j, c]
            sums[1, c] += yours[j, c]
            products[0, c] += rotated[j, c] * rotated[j, c]
            products[1, c] += yours[j, c] * yours[j, c]
            products[2, c] += rotated[j, c] * yours[j, c]
            steps[c] += (rotated[j, c] - yours[j, c]) ** 2
    share = np.float32(1.0) / np.float32(m + n)
    for block in range(blocks):
        low = block * k
        one = np.float32(0.0)
        other = np.float32(0.0)
        both = np.float32(0.0)
        square = np.float32(0.0)
        for c in range(low, low + k):
            one += products[0, c] - sums[0, c] * sums[0, c] * share
            other += products[1, c] - sums[1, c] * sums[1, c] * share
            both += products[2, c] - sums[0, c] * sums[1, c] * share
            square += steps[c]
        size = math.sqrt(max(0.0, float(one * other)))
        if size > 0.0:
            scores[0] += max(-1.0, min(1.0, float(both) / size)) / blocks
        scores[1] += math.sqrt(square) / (m + n) / blocks
        gamma = effective * 0.5 * (x.radius[block] + y.radius[block])
        scores[2] += 0.5 * _effective_share(x.warp[block], partners, there, low, k, gamma, n) / blocks
        scores[2] += 0.5 * _effective_share(y.warp[block], sources, back, low, k, gamma, m) / blocks


@kernel
def fit_map(
    x: MatchRecord,
    y: MatchRecord,
    rounds: SearchRounds,
    there: Int32s,
    back: Int32s,
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
    there : int32, shape (m,)
        Written: the sample of y that each of x is paired with.
    back : int32, shape (n,)
        Written: the sample of x that each of y is paired with.
    partners, sources : float32, shapes (m, b k) and (n, b k)
        Written: the partners of the samples of x and of those of y.
    rotation : float32, shape (b k, b k)
        Zeros; written where blocks meet themselves: x.points @ rotation lies on y.points.

    Returns
    -------
    float
        CC of the pairs, the mean over the domains.
    """
    m = len(there)
    n = len(back)
    blocks = x.searched.shape[0]
    columns = x.points.shape[1]
    mine = x.points[:m]
    yours = y.points[:n]
    best_map(x, y, rounds, rotation)
    targets = np.ascontiguousarray(yours.T)
    score = refine_map(mine, yours, targets, blocks, rounds.final_rounds, EXACT, rotation, there, back)
    covariance = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    gather(yours, there, partners)
    gather(mine, back, sources)
    ends = np.empty((m, columns), dtype=np.float32)
    starts = np.empty((n, columns), dtype=np.float32)
    for _ in range(rounds.slides):
        product(mine, rotation, ends)
        product(yours, np.ascontiguousarray(rotation.T), starts)
        for i in range(m):
            region = there[i]
            row = closest(y.points, y.members, y.offsets[region], y.offsets[region + 1], ends, i)
            for c in range(columns):
                partners[i, c] = y.points[row, c]
        for j in range(n):
            region = back[j]
            row = closest(x.points, x.members, x.offsets[region], x.offsets[region + 1], starts, j)
            for c in range(columns):
                sources[j, c] = x.points[row, c]
        cross_covariance(mine, partners, sources, yours, blocks, covariance, first, second)
        score = fit_rotation(covariance, first, second, EXACT, rotation)
    return score


@kernel
def match_pair(
    x: MatchRecord,
    y: MatchRecord,
    rounds: SearchRounds,
    same: bool,
    there: Int32s,
    back: Int32s,
    rotation: Float32s,
    scores: Floats,
) -> None:
    """Match two shapes: `fit_map`, then `score_pairs`.

    Parameters
    ----------
    x, y : MatchRecord
        Of m and n samples.
    rounds : SearchRounds
    same : bool
        Whether both are one shape: then each sample's partner is itself, and the scores are 1, 0 and 1 (CC
        counts 0 in a domain that is one point). A search might find one of the shape's symmetries.
    there : int32, shape (m,)
        Written: the sample of y that each of x is paired with.
    back : int32, shape (n,)
        Written: the sample of x that each of y is paired with.
    rotation : float32, shape (b k, b k)
        Written: x.points @ rotation lies on y.points.
    scores : float64, shape (3,)
        Written: CC, SSD and sim.
    """
    m = len(x.offsets) - 1
    n = len(y.offsets) - 1
    columns = x.points.shape[1]
    rotation[:] = 0.0
    if same:
        for c in range(columns):
            rotation[c, c] = 1.0
        for i in range(m):
            there[i] = i
            back[i] = i
        scores[0] = (x.radius > 0.0).mean()
        scores[1] = 0.0
        scores[2] = 1.0
        return
    partners = np.empty((m, columns), dtype=np.float32)
    sources = np.empty((n, columns), dtype=np.float32)
    fit_map(x, y, rounds, there, back, partners, sources, rotation)
    score_pairs(x, y, there, back, partners, sources, rotation, rounds.effective, scores)
