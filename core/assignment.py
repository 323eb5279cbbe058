"""The one-to-one correspondence of least total cost (the linear assignment problem)."""

import numpy as np

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

    The reductions and shortest augmenting paths of Jonker and Volgenant (1987). Compiled, so that it can run
    inside the compiled matching; `scipy.optimize.linear_sum_assignment` is the reference it is tested against.

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


def one_to_one(cost: Floats) -> Ints:
    """Pairs (row, column), shape (min(m, n), 2), of least total cost; `cost` may have either side longer."""
    if cost.shape[0] <= cost.shape[1]:
        columns = assign(np.ascontiguousarray(cost))
        return np.stack([np.arange(len(columns)), columns], axis=1)
    rows = assign(np.ascontiguousarray(cost.T))
    order = np.argsort(rows)
    return np.stack([rows[order], np.arange(len(rows))[order]], axis=1)
