"""Alignment by an orthogonal map and one-to-one pairs: signs, order and rotation of eigenvectors settled.

The assignment is compiled in this file too: the compiler's cache on disk is renewed when the file of a
function changes, and would not notice a change in another file that it calls.
"""

import numpy as np
from scipy.linalg import block_diag, orthogonal_procrustes
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
def fit(points: Floats, targets: Floats, matches: Ints, blocks: int) -> tuple[float, Floats]:
    """The orthogonal map, one for each block of columns, that brings points closest to their matches.

    Procrustes: R = U V^T of the centred cross-covariance U S V^T. The columns fall into `blocks` spectral
    domains of k each; R keeps each domain to itself.

    Parameters
    ----------
    points : float64, shape (m, blocks k)
    targets : float64, shape (n, blocks k)
    matches : int64, shape (m,)
        A row of targets for each point.
    blocks : int

    Returns
    -------
    cc : float
        Correlation of the matched coordinates after the map (the trace of S over the root of the product of
        the centred square sums), the mean over the blocks; a block that is one point counts 0.
    rotation : float64, shape (blocks k, blocks k)
        Block diagonal: points @ rotation lies on targets[matches].
    """
    m, columns = points.shape
    k = columns // blocks
    x = points.copy()
    y = np.empty_like(x)
    for i in range(m):
        y[i] = targets[matches[i]]
    for c in range(columns):
        x[:, c] -= x[:, c].mean()
        y[:, c] -= y[:, c].mean()
    cross = x.T @ y
    rotation = np.zeros((columns, columns))
    cc = 0.0
    for low in range(0, columns, k):
        high = low + k
        left, values, right = np.linalg.svd(np.ascontiguousarray(cross[low:high, low:high]))
        rotation[low:high, low:high] = left @ right
        size = np.sqrt((x[:, low:high] ** 2).sum() * (y[:, low:high] ** 2).sum())
        if size > 0.0:
            cc += min(1.0, values.sum() / size) / blocks
    return cc, rotation


@compiled
def align(
    points: Floats, targets: Floats, rotation: Floats, rounds: int, blocks: int
) -> tuple[float, Ints, Floats]:
    """One-to-one pairs and the orthogonal map, alternated from a first map.

    Eigenvectors are determined up to sign, and up to rotation where eigenvalues are equal or swap order (the
    arms of an octopus, a body of revolution). The orthogonal map that brings matched points closest (`fit`)
    undoes all of these; coordinates that carry their eigenvalue's weight make mixing unlike ones costly. Then
    the pairs are chosen anew as the one-to-one correspondence of least total squared distance. Many-to-one
    nearest neighbours would let every point slide onto a few targets and every two shapes correlate.

    Several embeddings stand side by side as blocks of columns: each has its own map, and all share one
    correspondence, which has to be right in every one of them.

    Parameters
    ----------
    points : float64, shape (m, blocks k), m <= n
    targets : float64, shape (n, blocks k)
    rotation : float64, shape (blocks k, blocks k)
        Where to start: points @ rotation lies near targets.
    rounds : int
        At most; it stops when the pairs stay.
    blocks : int

    Returns
    -------
    cc : float
        As of `fit`.
    matches : int64, shape (m,)
        All different.
    rotation : float64, shape (blocks k, blocks k)
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
        cc, rotation = fit(points, targets, matches, blocks)
    return cc, matches, rotation


def fit_reference(points: Floats, targets: Floats, matches: Ints, blocks: int) -> tuple[float, Floats]:
    """What `fit` finds, by SciPy."""
    maps: list[Floats] = []
    scores: list[float] = []
    for x, y in zip(np.split(points, blocks, 1), np.split(targets[matches], blocks, 1), strict=True):
        rotation, trace = orthogonal_procrustes(x - x.mean(axis=0), y - y.mean(axis=0))
        size = np.sqrt(((x - x.mean(axis=0)) ** 2).sum() * ((y - y.mean(axis=0)) ** 2).sum())
        maps.append(rotation)
        scores.append(trace / size if size > 0.0 else 0.0)
    return float(np.mean(scores)), np.asarray(block_diag(*maps))


def align_reference(
    points: Floats, targets: Floats, rotation: Floats, rounds: int, blocks: int
) -> tuple[float, Ints, Floats]:
    """What `align` finds, by SciPy."""
    matches = np.full(len(points), -1, dtype=np.int64)
    cc = 0.0
    for _ in range(rounds):
        chosen = linear_sum_assignment(cdist(points @ rotation, targets, "sqeuclidean"))[1]
        if (chosen == matches).all():
            break
        matches = chosen
        cc, rotation = fit_reference(points, targets, matches, blocks)
    return cc, matches, rotation
