"""The correspondence in the spectral domain: nearest neighbours under an iterated thin-plate spline (Eq. 17).

Arrays of points are float32, one row a point. The compiled functions release the GIL; `progressive_reference`
is the same search in plain NumPy.
"""

import math
from dataclasses import dataclass

import numpy as np

from core.arrays import Float32s, Floats, Ints
from core.matching.thin_plate_spline import ThinPlateSpline, mean_pair_distance
from core.numerics.compilation import compiled, compiled_fast


@dataclass(frozen=True)
class Search:
    """How the correspondence is searched.

    Attributes
    ----------
    first_dimensions : int
        Dimensions in which the search begins; one more is added a step, up to the embedding's k.
    sign_starts : bool
        Whether all 2^first_dimensions signs of the first coordinates are tried.
    kept_starts : int
        How many of the starts, best correlation first, are carried through all steps.
    start_iterations, step_iterations : int
        Spline and nearest-neighbour rounds for each start, and after each added dimension.
    """

    first_dimensions: int
    sign_starts: bool
    kept_starts: int
    start_iterations: int
    step_iterations: int


def smoothers(points: Floats, first_dimensions: int, stiffness: float) -> Float32s:
    """The spline's linear operators on one cloud, for each number of dimensions in turn.

    Parameters
    ----------
    points : float64, shape (m, k)
    first_dimensions : int
    stiffness : float
        beta as a multiple of the mean distance between all pairs of points.

    Returns
    -------
    float32, shape (k - first_dimensions + 1, m, m)
    """
    beta = stiffness * mean_pair_distance(points)
    stages = range(first_dimensions, points.shape[1] + 1)
    return np.stack([ThinPlateSpline(points[:, :k], beta).smoother() for k in stages]).astype(np.float32)


@compiled_fast
def _nearest(points: Float32s, targets: Float32s, k: int, matches: Ints, squares: Float32s) -> None:
    """Write the nearest of targets[:, j] to points[:, i], in k coordinates, to matches[i]."""
    n = targets.shape[1]
    for i in range(points.shape[1]):
        x = points[0, i]
        for j in range(n):
            step = x - targets[0, j]
            squares[j] = step * step
        for c in range(1, k):
            x = points[c, i]
            for j in range(n):
                step = x - targets[c, j]
                squares[j] += step * step
        least = squares[0]
        for j in range(1, n):
            least = min(least, squares[j])
        where = 0
        while squares[where] > least:
            where += 1
        matches[i] = where


@compiled
def _warp(smoother: Float32s, targets: Float32s, matches: Ints, k: int, warped: Float32s) -> None:
    """Write smoother @ targets[:, matches].T, its first k coordinates, to the rows of `warped`.

    The smoother is symmetric: its rows are added where its columns are meant, so that each step is a vector.
    """
    m = smoother.shape[0]
    warped[:k] = 0.0
    for c in range(k):
        for j in range(m):
            matched = targets[c, matches[j]]
            for i in range(m):
                warped[c, i] += smoother[j, i] * matched


@compiled
def _signless_correlation(points: Float32s, targets: Float32s, matches: Ints, k: int) -> float:
    """Correlation of the matched coordinates, each column with the sign that suits it."""
    m = points.shape[0]
    cross = 0.0
    first = 0.0
    second = 0.0
    for c in range(k):
        mean_x = 0.0
        mean_y = 0.0
        for i in range(m):
            mean_x += points[i, c]
            mean_y += targets[matches[i], c]
        mean_x /= m
        mean_y /= m
        column = 0.0
        for i in range(m):
            x = points[i, c] - mean_x
            y = targets[matches[i], c] - mean_y
            column += x * y
            first += x * x
            second += y * y
        cross += abs(column)
    if first <= 0.0 or second <= 0.0:
        return 0.0
    return cross / math.sqrt(first * second)


@compiled
def progressive(
    points: Float32s,
    targets: Float32s,
    operators: Float32s,
    first: int,
    starts: int,
    kept: int,
    start_rounds: int,
    step_rounds: int,
) -> Ints:
    """The correspondence from one cloud to another, dimension by dimension.

    Each start flips signs of the first coordinates, takes nearest neighbours and alternates the spline with
    them. The best starts are carried on: the spline in k + 1 dimensions is fitted to the correspondence found
    in k, which settles the sign and the order of the next coordinate (the idea of ZoomOut, Melzi et al. 2019,
    with the spline in place of the functional map).

    Parameters
    ----------
    points : float32, shape (m, k)
    targets : float32, shape (n, k)
    operators : float32, shape (k - first + 1, m, m)
        `smoothers` of `points`.
    first, starts, kept, start_rounds, step_rounds : int
        `Search`; starts is 2^first or 1.

    Returns
    -------
    matches : int64, shape (m,)
        A row of `targets` for each row of `points` (Eq. 17).
    """
    m, k_all = points.shape
    columns = np.ascontiguousarray(targets.T)
    warped = np.empty((k_all, m), dtype=np.float32)
    squares = np.empty(targets.shape[0], dtype=np.float32)
    tries = np.empty((starts, m), dtype=np.int64)
    scores = np.empty(starts)
    for s in range(starts):
        for i in range(m):
            for c in range(first):
                warped[c, i] = -points[i, c] if (s >> c) & 1 else points[i, c]
        _nearest(warped, columns, first, tries[s], squares)
        for _ in range(start_rounds):
            _warp(operators[0], columns, tries[s], first, warped)
            _nearest(warped, columns, first, tries[s], squares)
        scores[s] = _signless_correlation(points, targets, tries[s], first)
    order = np.argsort(-scores, kind="mergesort")
    best = -2.0
    winner = order[0]
    for place in range(min(kept, starts)):
        s = order[place]
        for k in range(first + 1, k_all + 1):
            for _ in range(step_rounds):
                _warp(operators[k - first], columns, tries[s], k, warped)
                _nearest(warped, columns, k, tries[s], squares)
        score = _signless_correlation(points, targets, tries[s], k_all)
        if score > best:
            best = score
            winner = s
    found_matches: Ints = tries[winner].copy()
    return found_matches


def _nearest_reference(points: Floats, targets: Floats) -> Ints:
    squares = ((points[:, None, :] - targets[None, :, :]) ** 2).sum(axis=2)
    return np.asarray(np.argmin(squares, axis=1))


def _correlation_reference(points: Floats, targets: Floats) -> float:
    x, y = points - points.mean(axis=0), targets - targets.mean(axis=0)
    return float(np.abs((x * y).sum(axis=0)).sum() / np.sqrt((x**2).sum() * (y**2).sum()))


def progressive_reference(points: Floats, targets: Floats, operators: Floats, search: Search) -> Ints:
    """What `progressive` finds, in plain NumPy."""
    first, k_all = search.first_dimensions, points.shape[1]
    found: list[tuple[float, Ints]] = []
    for s in range(2**first if search.sign_starts else 1):
        signs = np.array([-1.0 if (s >> c) & 1 else 1.0 for c in range(first)])
        matches = _nearest_reference(points[:, :first] * signs, targets[:, :first])
        for _ in range(search.start_iterations):
            matches = _nearest_reference(operators[0] @ targets[matches, :first], targets[:, :first])
        found.append((_correlation_reference(points[:, :first], targets[matches, :first]), matches))
    found.sort(key=lambda start: -start[0])
    ended: list[tuple[float, Ints]] = []
    for _, start in found[: search.kept_starts]:
        matches = start
        for k in range(first + 1, k_all + 1):
            for _ in range(search.step_iterations):
                matches = _nearest_reference(operators[k - first] @ targets[matches, :k], targets[:, :k])
        ended.append((_correlation_reference(points, targets[matches]), matches))
    return np.asarray(max(ended, key=lambda end: end[0])[1])
