"""The rigid part of the alignment: signs, order and rotation of eigenvectors, with one-to-one pairs."""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from core.assignment import assign
from core.compiled import compiled
from core.mesh import Floats, Ints


@compiled
def _cross(points: Floats, targets: Floats, matches: Ints) -> tuple[Floats, float, float]:
    """Sum of points[i] targets[matches[i]]^T about the two means, and the two centred square sums."""
    m, k = points.shape
    mean_x = np.zeros(k)
    mean_y = np.zeros(k)
    for i in range(m):
        for a in range(k):
            mean_x[a] += points[i, a] / m
            mean_y[a] += targets[matches[i], a] / m
    cross = np.zeros((k, k))
    first = 0.0
    second = 0.0
    for i in range(m):
        for a in range(k):
            x = points[i, a] - mean_x[a]
            y = targets[matches[i], a] - mean_y[a]
            first += x * x
            second += y * y
            for b in range(k):
                cross[a, b] += x * (targets[matches[i], b] - mean_y[b])
    return cross, first, second


@compiled
def align(points: Floats, targets: Floats, rotation: Floats, rounds: int) -> tuple[float, Ints, Floats]:
    """One-to-one pairs and the orthogonal map, alternated from a first map.

    Eigenvectors are determined up to sign, and up to rotation where eigenvalues are equal or swap order (the
    arms of an octopus, a body of revolution). The orthogonal map that brings matched points closest
    (Procrustes: R = U V^T of their cross-covariance) undoes all of these; coordinates that carry their
    eigenvalue's weight make mixing unlike ones costly. Then the pairs are chosen anew as the one-to-one
    correspondence of least total squared distance. Many-to-one nearest neighbours would let every point slide
    onto a few targets and every two shapes correlate.

    Parameters
    ----------
    points : float64, shape (m, k), m <= n
    targets : float64, shape (n, k)
    rotation : float64, shape (k, k)
        Where to start: points @ rotation lies near targets.
    rounds : int
        At most; it stops when the pairs stay.

    Returns
    -------
    cc : float
        Correlation of the matched coordinates after the map: the trace norm of the centred cross-covariance
        over the root of the product of the centred square sums.
    matches : int64, shape (m,)
        All different.
    rotation : float64, shape (k, k)
        points @ rotation lies on targets.
    """
    m, k = points.shape
    n = targets.shape[0]
    columns = np.ascontiguousarray(targets.T)
    lengths = np.zeros(n)
    for c in range(k):
        for j in range(n):
            lengths[j] += columns[c, j] * columns[c, j]
    cost = np.empty((m, n))
    matches = np.full(m, -1, dtype=np.int64)
    cc = 0.0
    for _ in range(rounds):
        turned = points @ rotation
        for i in range(m):
            own = 0.0
            for c in range(k):
                own += turned[i, c] * turned[i, c]
            for j in range(n):
                cost[i, j] = own + lengths[j]
            for c in range(k):
                x = 2.0 * turned[i, c]
                for j in range(n):
                    cost[i, j] -= x * columns[c, j]
        chosen = assign(cost)
        same = True
        for i in range(m):
            if chosen[i] != matches[i]:
                same = False
            matches[i] = chosen[i]
        if same:
            break
        cross, first, second = _cross(points, targets, matches)
        left, values, right = np.linalg.svd(cross)
        rotation = left @ right
        if first > 0.0 and second > 0.0:
            cc = min(1.0, values.sum() / np.sqrt(first * second))
    return cc, matches, rotation


def procrustes(points: Floats, targets: Floats) -> Floats:
    """The orthogonal map, shape (k, k), that brings paired points closest: points @ R lies on targets."""
    x, y = points - points.mean(axis=0), targets - targets.mean(axis=0)
    left, _, right = np.linalg.svd(x.T @ y)
    return np.asarray(left @ right)


def align_reference(
    points: Floats, targets: Floats, rotation: Floats, rounds: int
) -> tuple[float, Ints, Floats]:
    """What `align` finds, by SciPy."""
    matches = np.full(len(points), -1, dtype=np.int64)
    for _ in range(rounds):
        chosen = linear_sum_assignment(cdist(points @ rotation, targets, "sqeuclidean"))[1]
        if (chosen == matches).all():
            break
        matches = chosen
        rotation = procrustes(points, targets[matches])
    x = (points - points.mean(axis=0)) @ rotation
    y = targets[matches] - targets[matches].mean(axis=0)
    return float((x * y).sum() / np.sqrt((x**2).sum() * (y**2).sum())), matches, rotation
