"""Alignment by an orthogonal map and one-to-one pairs: signs, order and rotation of eigenvectors settled.

The assignment is compiled in this file too: the compiler's cache on disk is renewed when the file of a
function changes, and would not notice a change in another file that it calls.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from core.compiled import compiled
from core.mesh import Floats, Ints

TIE = 1e-12
"""Two columns whose reduced costs differ by less are equally good to a row."""

BIDS_PER_ROW = 20
"""Bidding stops after so many bids a row on average: rounding could keep two rows at it for ever."""


@compiled
def _reduce(cost: Floats, price: Floats, row_of: Ints, column_of: Ints) -> None:
    """Prices and a partial assignment to start a square problem from: Jonker and Volgenant's reductions.

    Every column takes its cheapest free row and that cost as its price; each row assigned once passes on what
    it can spare; then free rows bid for their best column against the second best, displacing its row. Prices
    stay feasible: each assigned column is its row's cheapest after prices.
    """
    n = len(price)
    wanted = np.zeros(n, dtype=np.int64)
    for j in range(n - 1, -1, -1):
        least = 0
        for i in range(1, n):
            if cost[i, j] < cost[least, j]:
                least = i
        price[j] = cost[least, j]
        wanted[least] += 1
        if wanted[least] == 1:
            column_of[least] = j
            row_of[j] = least
    free = np.empty(n, dtype=np.int64)
    number = 0
    for i in range(n):
        if wanted[i] == 0:
            free[number] = i
            number += 1
        elif wanted[i] == 1:
            own = column_of[i]
            spare = np.inf
            for j in range(n):
                if j != own:
                    spare = min(spare, cost[i, j] - price[j])
            price[own] -= spare - (cost[i, own] - price[own])
    bids = 0
    for _ in range(2):
        place = 0
        pending = number
        number = 0
        while place < pending:
            i = free[place]
            place += 1
            first = np.inf
            second = np.inf
            best = 0
            other = 0
            for j in range(n):
                reduced = cost[i, j] - price[j]
                if reduced < second:
                    if reduced < first:
                        second = first
                        other = best
                        first = reduced
                        best = j
                    else:
                        second = reduced
                        other = j
            bids += 1
            gain = second - first
            displaced = row_of[best]
            if gain > TIE:
                price[best] -= gain
            elif displaced >= 0:
                best = other
                displaced = row_of[best]
            row_of[best] = i
            column_of[i] = best
            if displaced >= 0:
                column_of[displaced] = -1
                if gain > TIE and bids < BIDS_PER_ROW * n:
                    place -= 1
                    free[place] = displaced
                else:
                    free[number] = displaced
                    number += 1


@compiled
def assign(cost: Floats) -> Ints:
    """A different column for each row so that the sum of the costs chosen is least.

    The reductions and shortest augmenting paths of Jonker and Volgenant (1987). Compiled, so that it can
    run inside the compiled matching; `scipy.optimize.linear_sum_assignment` is the reference that it is
    tested against.

    Parameters
    ----------
    cost : float64, shape (m, n), m <= n

    Returns
    -------
    int64, shape (m,)
    """
    rows, columns = cost.shape
    row_price = np.empty(rows)
    column_price = np.zeros(columns)
    row_of = np.full(columns, -1, dtype=np.int64)
    column_of = np.full(rows, -1, dtype=np.int64)
    if rows == columns and rows > 1:
        _reduce(cost, column_price, row_of, column_of)
    for i in range(rows):
        best = np.inf
        for j in range(columns):
            best = min(best, cost[i, j] - column_price[j])
        row_price[i] = best
    shortest = np.empty(columns)
    previous = np.empty(columns, dtype=np.int64)
    remaining = np.empty(columns, dtype=np.int64)
    seen_row = np.empty(rows, dtype=np.bool_)
    seen_column = np.empty(columns, dtype=np.bool_)
    for start in range(rows):
        if column_of[start] >= 0:
            continue
        shortest[:] = np.inf
        seen_row[:] = False
        seen_column[:] = False
        for j in range(columns):
            remaining[j] = j
        left = columns
        reached = 0.0
        i = start
        sink = -1
        while sink < 0:
            seen_row[i] = True
            low = np.inf
            place = 0
            base = reached - row_price[i]
            for p in range(left):
                j = remaining[p]
                way = base + cost[i, j] - column_price[j]
                if way < shortest[j]:
                    shortest[j] = way
                    previous[j] = i
                if shortest[j] < low or (shortest[j] == low and row_of[j] < 0):
                    low = shortest[j]
                    place = p
            reached = low
            j = remaining[place]
            seen_column[j] = True
            left -= 1
            remaining[place] = remaining[left]
            if row_of[j] < 0:
                sink = j
            else:
                i = row_of[j]
        row_price[start] += reached
        for r in range(rows):
            if seen_row[r] and r != start:
                row_price[r] += reached - shortest[column_of[r]]
        for j in range(columns):
            if seen_column[j]:
                column_price[j] -= reached - shortest[j]
        j = sink
        while True:
            i = previous[j]
            row_of[j] = i
            following = column_of[i]
            column_of[i] = j
            j = following
            if i == start:
                break
    return column_of


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
