"""Diffusion on the graph of nearest neighbours: an order of candidates that reads what is like them, too.

Two shapes of one class may have little in common and still be joined by a chain of others, each like the
next. A random walk from the query finds such chains (D. Zhou et al., "Ranking on data manifolds", NIPS 2003;
M. Donoser, H. Bischof, "Diffusion processes for retrieval revisited", CVPR 2013): with the normalised weights
P of the graph, the flow is the solution f of (I - `DAMPING` P) f = e, where e marks the query.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import cg
from scipy.special import expit

from core.arrays import Floats, Ints

NEIGHBOURS = 16
"""Nearest neighbours that the graph holds for each shape."""

LINKED = 8
"""Neighbours of each shape that a walk may go to: the others count where the nearest are left out."""

MOST_NODES = 1_000
"""The most shapes around a query on which a flow is computed."""

DAMPING = 0.8
"""Probability of a further step of the walk."""

DECAY, NARROWEST, WIDEST = 3.0, 1e-6, 12.0
"""A link weighs the probability of its pair, times exp(-`DECAY`) for each spread of log odds below the
shape's best link. The spread, from `NARROWEST` to `WIDEST`, is that of the shape's links (self-tuning
affinities: L. Zelnik-Manor, P. Perona, NIPS 2004). Log odds between individuals of one kind differ by
tenths, far up where probabilities are 1: without this factor they would be one cluster."""

LEAST_FLOW, LOG_ODDS_WEIGHT = 1e-6, 0.125
"""A contextual score is log(flow + `LEAST_FLOW`) + `LOG_ODDS_WEIGHT` log odds."""

NOBODY = -1
"""Stands for a neighbour that a row lacks."""


@dataclass(frozen=True, eq=False)
class NeighbourRows:
    """The nearest neighbours of n shapes.

    Attributes
    ----------
    shapes : int64, shape (n,)
        Numbers of the shapes, ascending.
    neighbours : int64, shape (n, k)
        Numbers of their neighbours, the likeliest first; `NOBODY` where a shape has fewer than k.
    log_odds : float64, shape (n, k)
        Log odds that both are of one class; -inf beside `NOBODY`.
    """

    shapes: Ints
    neighbours: Ints
    log_odds: Floats

    def links(self) -> tuple[Ints, Floats]:
        """Return the neighbours as indices of `shapes`, and their log odds; those that are not there go."""
        if not len(self.shapes):
            return self.neighbours, self.log_odds
        indices = np.searchsorted(self.shapes, self.neighbours).clip(max=len(self.shapes) - 1)
        known = self.shapes[indices] == self.neighbours
        return np.where(known, indices, NOBODY), np.where(known, self.log_odds, -np.inf)


def contextual_scores(rows: NeighbourRows, log_odds: Floats) -> Floats:
    """Return scores of n shapes, shape (n,), that order them for a query; a higher score is more similar.

    The scores are no probabilities, and compare shapes for one query only.

    Parameters
    ----------
    rows : NeighbourRows
        The graph around the candidates, without the query itself: it enters the row of each shape to which it
        is nearer than the shape's last linked neighbour.
    log_odds : float64, shape (n,)
        Log odds that the query and each shape are of one class; -inf for shapes that were not compared with
        it, whose scores are -inf.
    """
    if not len(log_odds):
        return np.empty(0)
    flow = query_flow(*rows.links(), log_odds)
    return np.asarray(np.log(flow + LEAST_FLOW) + LOG_ODDS_WEIGHT * log_odds)


def unreached_scores(log_odds: Floats) -> Floats:
    """Return contextual scores of shapes that no flow reaches, shape (n,), from their log odds."""
    return np.asarray(np.log(LEAST_FLOW) + LOG_ODDS_WEIGHT * log_odds)


def query_flow(links: Ints, link_log_odds: Floats, log_odds: Floats) -> Floats:
    """Return the flow from a query to each of n shapes, shape (n,), >= 0.

    `links` and `link_log_odds`, shape (n, k), are those of `NeighbourRows.links`; `log_odds`, shape (n,), are
    those of the query.
    """
    query = len(log_odds)
    # The query is one more neighbour of each shape.
    targets = np.column_stack([links, np.full(query, query)])
    values = np.column_stack([link_log_odds, log_odds])
    nearest = np.argsort(-values, axis=1, kind="stable")[:, :LINKED]
    targets, values = np.take_along_axis(targets, nearest, 1), np.take_along_axis(values, nearest, 1)
    own = np.argsort(-log_odds, kind="stable")[:LINKED]
    sources = np.concatenate([np.repeat(np.arange(query), targets.shape[1]), np.full(len(own), query)])
    weights = np.concatenate([link_weights(values).ravel(), link_weights(log_odds[own][None]).ravel()])
    targets = np.concatenate([targets.ravel(), own])
    linked = weights > 0.0
    graph = csr_array((weights[linked], (sources[linked], targets[linked])), shape=(query + 1, query + 1))
    graph = (graph + graph.T) / 2.0
    # A shape without links keeps its row of zeros.
    degrees = np.asarray(graph.sum(axis=1))
    roots = diags_array(np.divide(1.0, np.sqrt(degrees), out=np.zeros(query + 1), where=degrees > 0.0))
    system = eye_array(query + 1) - DAMPING * (roots @ graph @ roots)
    start = np.zeros(query + 1)
    start[query] = 1.0
    # The eigenvalues of the system are in [1 - DAMPING, 1 + DAMPING]: about thirty steps suffice.
    flow, _ = cg(system, start, rtol=1e-10, atol=0.0, maxiter=200)
    return np.asarray(np.maximum(flow[:query], 0.0))


def link_weights(log_odds: Floats) -> Floats:
    """Return weights of links, shape (n, k), from log odds; 0 where these are -inf, as beside `NOBODY`."""
    linked = np.isfinite(log_odds)
    best = np.max(log_odds, axis=1, keepdims=True, initial=-np.inf, where=linked)
    last = np.min(log_odds, axis=1, keepdims=True, initial=np.inf, where=linked)
    below = np.subtract(best, log_odds, out=np.full(log_odds.shape, np.inf), where=linked)
    return np.asarray(expit(log_odds) * np.exp(-DECAY * below / np.clip(best - last, NARROWEST, WIDEST)))


def nearest_rows(log_odds: Floats) -> NeighbourRows:
    """Return the neighbours of n shapes, numbered from 0, from the log odds of all pairs, shape (n, n).

    The diagonal does not count.
    """
    others = np.array(log_odds, dtype=np.float64)
    np.fill_diagonal(others, -np.inf)
    nearest = np.argsort(-others, axis=1, kind="stable")[:, : min(NEIGHBOURS, len(others) - 1)]
    return NeighbourRows(np.arange(len(others)), nearest, np.take_along_axis(others, nearest, 1))


def all_contextual_scores(log_odds: Floats) -> Floats:
    """Return contextual scores of n shapes for each of them as the query, shape (n, n), by log odds likewise.

    Each query is left out of the graph, and enters it as one that is not stored would. No flow reaches the
    diagonal, and shapes beyond the `MOST_NODES` likeliest ones for a query.
    """
    rows = nearest_rows(log_odds)
    scores = unreached_scores(log_odds)
    for query in range(len(log_odds)):
        order = np.argsort(-log_odds[query], kind="stable")
        nodes = np.sort(order[order != query][:MOST_NODES])
        around = NeighbourRows(nodes, rows.neighbours[nodes], rows.log_odds[nodes])
        scores[query, nodes] = contextual_scores(around, log_odds[query, nodes])
    return scores
