"""Families of shapes: groups that links of the graph of neighbours join.

Two shapes are joined if each is a neighbour of the other, their log odds are at least a bound, and they
share at least half of their neighbours (R. A. Jarvis, E. A. Patrick, "Clustering using a similarity measure
based on shared near neighbors", 1973): a single pair of look-alikes does not join two families.
"""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Ints
from core.ranking.diffusion import LINKED, NOBODY, NeighbourRows

LEAST_SHARED = 0.5
"""The least share of common neighbours among all neighbours of two shapes, themselves included."""


def families(rows: NeighbourRows, least_log_odds: float) -> Ints:
    """Return a number of the family of each of n shapes, shape (n,); the numbers begin at 0.

    Neighbours beyond the first `LINKED`, and those that are not among the shapes, do not count.
    """
    links, log_odds = (array[:, :LINKED] for array in rows.links())
    count = len(links)
    sources, columns = np.nonzero((links != NOBODY) & (log_odds >= least_log_odds))
    targets = links[sources, columns]
    mutual = (links[targets] == sources[:, None]).any(axis=1)
    sources, targets = sources[mutual], targets[mutual]
    # Each shape counts among its own neighbours.
    around = np.column_stack([links, np.arange(count)])
    first, second = around[sources], around[targets]
    found = (first[:, :, None] == second[:, None, :]) & (first != NOBODY)[:, :, None]
    common = found.any(axis=2).sum(axis=1)
    sizes = (around != NOBODY).sum(axis=1)
    joined = common >= LEAST_SHARED * (sizes[sources] + sizes[targets] - common)
    graph = csr_array((joined[joined], (sources[joined], targets[joined])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
