"""The compiled spline search of the Procrustes matcher, on few points (Eq. 17).

The search is that of `core.matching.correspondence.spline_search`, its reference, with one start kept. Every
inner loop is a SIMD loop: all first signs go through one product, and the nearest neighbour is a running
minimum over the targets, in integers that carry the target's number in their lowest bits.
"""

import math

import numpy as np

from core.arrays import Float32s, Int16s, Int32s
from core.matching.kernels.match_record import dequantised
from core.matching.kernels.matrix_product import product
from core.numerics.compilation import kernel

FAR = np.int32(2**31 - 1)


@kernel
def nearest_columns(points: Float32s, targets: Float32s, k: int, low: int, nearest: Int32s) -> None:
    """Write the nearest of n targets to each of p points, both held by columns, in their first k dimensions.

    Squared distances are compared in their leading bits; among equals the first target wins.

    Parameters
    ----------
    points : float32, shape (>= k, p)
    targets : float32, shape (>= k, n)
    low : int
        2^b > n, at most 2^14: the b last of a distance's 23 bits hold the target's number.
    nearest : int32, shape (p,)
    """
    p = points.shape[1]
    squares = np.empty(p, dtype=np.float32)
    bits = squares.view(np.int32)
    high = np.int32(-low)
    for i in range(p):
        nearest[i] = FAR
    for j in range(targets.shape[1]):
        y = targets[0, j]
        for i in range(p):
            squares[i] = (points[0, i] - y) * (points[0, i] - y)
        for c in range(1, k):
            y = targets[c, j]
            for i in range(p):
                squares[i] += (points[c, i] - y) * (points[c, i] - y)
        number = np.int32(j)
        for i in range(p):
            nearest[i] = min(nearest[i], np.int32(np.int32(bits[i] & high) | number))
    last = np.int32(low - 1)
    for i in range(p):
        nearest[i] &= last


@kernel
def signless_correlation(points: Float32s, targets: Float32s, matches: Int32s, k: int) -> float:
    """Correlation of the first k of matched columns, each with the sign that suits it; clouds by columns."""
    p = points.shape[1]
    cross = np.float32(0.0)
    first = np.float32(0.0)
    second = np.float32(0.0)
    for c in range(k):
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
    low: int,
    matches: Int32s,
) -> None:
    """Write the target of each point, as the best start finds it (Eq. 17).

    Parameters
    ----------
    points : float32, shape (k, s)
        By columns: row c holds coordinate c of all points.
    targets : float32, shape (k, n)
    operators : int16, shape (k - first + 1, s, s)
        Symmetric: `core.matching.spline_operators` of the points, over `match_record.ONE`.
    first : int
        Dimensions of the first stage.
    starts : int
        2^first sign changes of the first coordinates, or 1 for none.
    start_rounds, step_rounds : int
        Spline rounds of every start, and of the best one after each dimension added.
    low : int
        See `nearest_columns`.
    matches : int32, shape (s,)
    """
    k_all, s = points.shape
    several = starts * s
    stacked = np.empty((first, several), dtype=np.float32)
    found = np.empty(several, dtype=np.int32)
    for c in range(first):
        for start in range(starts):
            sign = np.float32(-1.0) if (start >> c) & 1 else np.float32(1.0)
            for i in range(s):
                stacked[c, start * s + i] = sign * points[c, i]
    nearest_columns(stacked, targets, first, low, found)
    matched = np.empty((max(first * starts, k_all), s), dtype=np.float32)
    warped = np.empty((len(matched), s), dtype=np.float32)
    for _ in range(start_rounds):
        for c in range(first):
            for start in range(starts):
                for i in range(s):
                    matched[c * starts + start, i] = targets[c, found[start * s + i]]
        product(matched[: first * starts], dequantised(operators[0]), warped[: first * starts])
        nearest_columns(warped[: first * starts].reshape(first, several), targets, first, low, found)
    best = 0
    score = -2.0
    for start in range(starts):
        likeness = signless_correlation(points, targets, found[start * s : start * s + s], first)
        if likeness > score:
            score = likeness
            best = start
    for i in range(s):
        matches[i] = found[best * s + i]
    for k in range(first + 1, k_all + 1):
        operator = dequantised(operators[k - first])
        for _ in range(step_rounds):
            for c in range(k):
                for i in range(s):
                    matched[c, i] = targets[c, matches[i]]
            product(matched[:k], operator, warped[:k])
            nearest_columns(warped[:k], targets, k, low, matches)
