"""The orthogonal map between two paired clouds: Procrustes by a polar factor of matrix products alone."""

import math

import numpy as np

from core.arrays import Float32s, Floats
from core.matching.kernels.simd import Vector, entry, fused, load, repeat, store
from core.numerics.compilation import constant, inlined, kernel

ROUGH = constant(
    np.array(
        [
            (8.458838, -24.8550361, 18.2648487),
            (4.2136983, -3.0980635, 0.5703304),
            (4.1435814, -3.0500064, 0.5649399),
            (3.8766156, -2.864991, 0.5442039),
            (3.1194696, -2.3174629, 0.4831764),
            (2.1571445, -1.5274061, 0.3980536),
            (1.876218, -1.2468613, 0.3706892),
        ],
        dtype=np.float32,
    )
)
"""Polynomials a x + b x^3 + c x^5, rows (a, b, c), that one after another take [3e-4, 1] to within 3e-4 of 1.

Each is the best one on the interval that the ones before leave, made wider by half a percent for rounding
(Amsel et al. 2025, The Polar Express). For maps whose pairs still change.
"""

EXACT = constant(
    np.array(
        [
            (8.4675707, -24.8891883, 18.2917509),
            (4.2285156, -3.1081925, 0.5714667),
            (4.2046087, -3.0918455, 0.5696329),
            (4.1069739, -3.0248317, 0.5621167),
            (3.7503418, -2.776237, 0.5342698),
            (2.866187, -2.123686, 0.461817),
            (2.0249173, -1.4006321, 0.3852356),
            (1.8714169, -1.2417401, 0.3703295),
            (1.875, -1.25, 0.375),
        ],
        dtype=np.float32,
    )
)
"""As `ROUGH`, from [1e-4, 1] to within rounding of 1, for maps that are scored."""


LANES = 8
"""Matrices side by side, one a lane: each entry of theirs is a vector."""


@inlined
def _lane_tile(
    left: Float32s, first: int, second: int, down: int, right: Float32s, begin: int, step: int, count: int
) -> tuple[Vector, Vector, Vector, Vector, Vector, Vector, Vector, Vector]:
    """Return 2 x 4 entries of a product of matrices in lanes, one row after the other.

    An entry of the first row is the sum over c < count of left[first + c down] times
    right[begin + c step + column].
    """
    nought = repeat(np.float32(0.0), LANES)
    a, b, c, d, e, f, g, h = nought, nought, nought, nought, nought, nought, nought, nought
    for place in range(count):
        upper, lower = load(left, first + place * down, LANES), load(left, second + place * down, LANES)
        start = begin + place * step
        column = load(right, start, LANES)
        a, e = fused(upper, column, a), fused(lower, column, e)
        column = load(right, start + LANES, LANES)
        b, f = fused(upper, column, b), fused(lower, column, f)
        column = load(right, start + 2 * LANES, LANES)
        c, g = fused(upper, column, c), fused(lower, column, g)
        column = load(right, start + 3 * LANES, LANES)
        d, h = fused(upper, column, d), fused(lower, column, h)
    return a, b, c, d, e, f, g, h


@kernel
def _gram(matrix: Float32s, gram: Float32s) -> None:
    """Write the transpose of matrices times themselves, all of shape (k, w, LANES)."""
    k, width, _ = matrix.shape
    down = width * LANES
    for i in range(0, k, 2):
        following = min(i + 1, k - 1)
        for j in range(0, following + 1, 4):
            a, b, c, d, e, f, g, h = _lane_tile(
                matrix, i * LANES, following * LANES, down, matrix, j * LANES, down, k
            )
            place = following * down + j * LANES
            store(e, gram, place)
            store(f, gram, place + LANES)
            store(g, gram, place + 2 * LANES)
            store(h, gram, place + 3 * LANES)
            place = i * down + j * LANES
            store(a, gram, place)
            store(b, gram, place + LANES)
            store(c, gram, place + 2 * LANES)
            store(d, gram, place + 3 * LANES)
    for i in range(k):
        for j in range(i):
            store(load(gram, i * down + j * LANES, LANES), gram, j * down + i * LANES)


@kernel
def nearest_rotations(matrices: Float32s, steps: Float32s, rotations: Float32s, traces: Float32s) -> None:
    """Write the polar factors U V^T of LANES matrices U S V^T, and their traces with the matrices, sums of S.

    By odd polynomials of the matrix over its Frobenius norm: X <- a X + X (b G + c G^2), G = X^T X, each of
    which brings the singular values nearer to 1. Smaller singular values than the steps are made for come out
    between 0 and 1, continuously: rounding does not settle a direction that the matrix does not determine.

    Parameters
    ----------
    matrices : float32, shape (k, w, LANES)
        Padded with zeros to a multiple w of four columns.
    steps : float32, shape (n, 3)
        `ROUGH` or `EXACT`.
    rotations : float32, shape (k, w, LANES)
        Written.
    traces : float32, shape (LANES,)
        Written.
    """
    k, width, _ = matrices.shape
    down = width * LANES
    # The Frobenius norms, in a sum for each column.
    sizes = repeat(np.float32(0.0), LANES)
    for j in range(k):
        squares = repeat(np.float32(0.0), LANES)
        for i in range(k):
            entries = load(matrices, i * down + j * LANES, LANES)
            squares = squares + entries * entries
        sizes = sizes + squares
    store(sizes, traces, 0)
    for number in range(LANES):
        size = traces[number]
        traces[number] = np.float32(1.0 / math.sqrt(size)) if size > 0.0 else np.float32(0.0)
    scales = load(traces, 0, LANES)
    # X, of singular values at most 1, in two arrays by turns.
    current = np.empty((k, width, LANES), dtype=np.float32)
    following = rotations
    gram = np.zeros((k, width, LANES), dtype=np.float32)
    factor = np.zeros((k, width, LANES), dtype=np.float32)
    if len(steps) % 2 == 0:
        current, following = following, current
    for place in range(0, k * down, LANES):
        store(load(matrices, place, LANES) * scales, current, place)
    for step in range(len(steps)):
        # G, and the polynomial of G without its constant: b G + c G^2.
        _gram(current, gram)
        _gram(gram, factor)
        linear, square = entry(steps, 3 * step + 1, LANES), entry(steps, 3 * step + 2, LANES)
        for place in range(0, k * down, LANES):
            addend = load(gram, place, LANES) * linear
            store(fused(load(factor, place, LANES), square, addend), factor, place)
        # The next X: a X + X (b G + c G^2).
        constant = entry(steps, 3 * step, LANES)
        for i in range(0, k, 2):
            upper, lower = i * down, min(i + 1, k - 1) * down
            for j in range(0, down, 4 * LANES):
                a, b, c, d, e, f, g, h = _lane_tile(current, upper, lower, LANES, factor, j, down, k)
                place = lower + j
                store(e + load(current, place, LANES) * constant, following, place)
                place += LANES
                store(f + load(current, place, LANES) * constant, following, place)
                place += LANES
                store(g + load(current, place, LANES) * constant, following, place)
                place += LANES
                store(h + load(current, place, LANES) * constant, following, place)
                place = upper + j
                store(a + load(current, place, LANES) * constant, following, place)
                place += LANES
                store(b + load(current, place, LANES) * constant, following, place)
                place += LANES
                store(c + load(current, place, LANES) * constant, following, place)
                place += LANES
                store(d + load(current, place, LANES) * constant, following, place)
        current, following = following, current
    # The traces with the matrices, in a sum for each column.
    total = repeat(np.float32(0.0), LANES)
    for j in range(k):
        column = repeat(np.float32(0.0), LANES)
        for i in range(k):
            place = i * down + j * LANES
            column = column + load(rotations, place, LANES) * load(matrices, place, LANES)
        total = total + column
    store(total, traces, 0)


@kernel
def fit_rotations(
    covariances: Float32s,
    first: Float32s,
    second: Float32s,
    steps: Float32s,
    rotations: Float32s,
    scores: Floats,
) -> None:
    """Write r orthogonal maps, one for each of b spectral domains, and the correlations after them.

    A correlation is the mean over the domains of the trace over the root of the product of the square sums; a
    domain where either is one point counts 0.

    Parameters
    ----------
    covariances : float32, shape (r, b, k, k)
        Cross-covariances of paired points.
    first, second : float32, shape (r, b)
        Their centred square sums, over each domain.
    steps : float32, shape (n, 3)
        See `nearest_rotations`.
    rotations : float32, shape (r, b k, b k)
        Written where domains meet themselves: points of the first times it lie on those of the second.
    scores : float64, shape (r,)
        Written.
    """
    count, domains, k, _ = covariances.shape
    width = (k + 3) // 4 * 4
    matrices = np.zeros((k, width, LANES), dtype=np.float32)
    factors = np.empty((k, width, LANES), dtype=np.float32)
    traces = np.empty(LANES, dtype=np.float32)
    scores[:] = 0.0
    for start in range(0, count * domains, LANES):
        used = min(LANES, count * domains - start)
        for number in range(used):
            which, domain = divmod(start + number, domains)
            for i in range(k):
                for j in range(k):
                    matrices[i, j, number] = covariances[which, domain, i, j]
        nearest_rotations(matrices, steps, factors, traces)
        for number in range(used):
            which, domain = divmod(start + number, domains)
            low = domain * k
            for i in range(k):
                for j in range(k):
                    rotations[which, low + i, low + j] = factors[i, j, number]
            # The correlation after the map.
            size = math.sqrt(max(0.0, first[which, domain] * second[which, domain]))
            if size > 0.0:
                scores[which] += min(1.0, float(traces[number]) / size) / domains
