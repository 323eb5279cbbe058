"""The one-to-one correspondence of least total cost (the linear assignment problem)."""

import numpy as np

from core.compiled import compiled
from core.mesh import Floats, Ints


@compiled
def assign(cost: Floats) -> Ints:
    """A different column for each row so that the sum of the costs chosen is least.

    Shortest augmenting paths (Jonker and Volgenant 1987) after a start in which every row that can takes its
    cheapest column. Compiled, so that it can run inside the compiled matching; `scipy.optimize`'s
    `linear_sum_assignment` is the reference it is tested against.

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
    for i in range(rows):
        best = 0
        for j in range(1, columns):
            if cost[i, j] < cost[i, best]:
                best = j
        row_price[i] = cost[i, best]
        if row_of[best] < 0:
            row_of[best] = i
            column_of[i] = best
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
