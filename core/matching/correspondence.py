"""The correspondence in the spectral domain: nearest neighbours under an iterated thin-plate spline (Eq. 17).

This plain NumPy search is the TPS matcher's. It is also the reference of the Procrustes matcher's compiled
search, `core.matching.kernels.spline_search`.
"""

import numpy as np

from core.arrays import Floats, Ints, Reals


def spline_search(
    points: Reals,
    targets: Reals,
    operators: Reals,
    *,
    starts: int,
    kept_starts: int,
    start_iterations: int,
    step_iterations: int,
) -> Ints:
    """The correspondence from one cloud to another, dimension by dimension.

    Each start flips signs of the first coordinates, takes nearest neighbours and alternates the spline with
    them. The best starts are carried on: the spline in k + 1 dimensions is fitted to the correspondence found
    in k, which settles the sign and the order of the next coordinate (the idea of ZoomOut, Melzi et al. 2019,
    with the spline in place of the functional map).

    Parameters
    ----------
    points : float32 or float64, shape (m, k)
    targets : of the same type, shape (n, k)
    operators : of the same type, shape (stages, m, m)
        `core.matching.spline_operators.spline_operators` of `points`. The search begins in k - stages + 1
        dimensions; each stage adds one.
    starts : int
        Sign changes of the first coordinates: 2^(k - stages + 1) for all, 1 for none.
    kept_starts : int
        Number of starts, best correlation first, that are carried through all stages.
    start_iterations, step_iterations : int
        Rounds of spline and nearest neighbours for each start, and after each added dimension.

    Returns
    -------
    int64, shape (m,)
        A row of `targets` for each row of `points`.
    """
    k_all = points.shape[1]
    first = k_all - len(operators) + 1
    started: list[tuple[float, Ints]] = []
    for start in range(starts):
        signs = np.array([-1.0 if (start >> c) & 1 else 1.0 for c in range(first)], dtype=points.dtype)
        matches = _nearest(points[:, :first] * signs, targets[:, :first])
        for _ in range(start_iterations):
            matches = _nearest(_warp(operators[0], targets[matches, :first]), targets[:, :first])
        started.append((_signless_correlation(points[:, :first], targets[matches, :first]), matches))
    started.sort(key=lambda scored: -scored[0])
    finished: list[tuple[float, Ints]] = []
    for _, start_matches in started[:kept_starts]:
        matches = start_matches
        for stage, k in enumerate(range(first + 1, k_all + 1), start=1):
            for _ in range(step_iterations):
                matches = _nearest(_warp(operators[stage], targets[matches, :k]), targets[:, :k])
        finished.append((_signless_correlation(points, targets[matches]), matches))
    return max(finished, key=lambda scored: scored[0])[1]


def _nearest(points: Reals, targets: Reals) -> Ints:
    """The row of targets (n, k) nearest to each of the points (m, k); of equals, the first."""
    squares = np.zeros((len(points), len(targets)), dtype=points.dtype)
    step = np.empty_like(squares)
    for x, y in zip(points.T, np.ascontiguousarray(targets.T), strict=True):
        np.subtract(x[:, None], y[None, :], out=step)
        squares += np.square(step, out=step)
    return np.asarray(squares.argmin(axis=1))


def _warp(operator: Reals, matched: Reals) -> Reals:
    """Operator @ matched, shape (m, k), of a symmetric operator (m, m).

    Summed row by row, in one order on every machine: the order of a matrix product hangs on the library, and
    last bits decide between neighbours that are nearly equally near.
    """
    return np.stack([(operator * column[:, None]).sum(axis=0) for column in matched.T], axis=1)


def _signless_correlation(points: Reals, targets: Reals) -> float:
    """Correlation of matched points, both of shape (m, k), each column with the sign that suits it."""
    x, y = points.astype(np.float64), targets.astype(np.float64)
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    squares = _sum(x.T**2) * _sum(y.T**2)
    return _sum(np.abs((x * y).sum(axis=0))) / float(np.sqrt(squares)) if squares > 0.0 else 0.0


def _sum(values: Floats) -> float:
    """The sum in the order of memory, for the reason told in `_warp`."""
    return float(np.cumsum(values)[-1])
