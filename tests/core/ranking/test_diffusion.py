"""The flow of a query through the graph of neighbours: a dense inverse, closed forms and invariances."""

import numpy as np
import pytest
from scipy.special import expit, logit

from core.ranking.diffusion import (
    DAMPING,
    DECAY,
    LINKED,
    LOG_ODDS_WEIGHT,
    NEIGHBOURS,
    NOBODY,
    WIDEST,
    NeighbourRows,
    all_contextual_scores,
    contextual_scores,
    link_weights,
    nearest_rows,
    query_flow,
)

CLASSES, EACH = 4, 24


def collection(seed: int = 0):
    """Log odds of all pairs of points on arcs: neighbours are near, the ends of an arc are not."""
    random = np.random.default_rng(seed)
    along = np.tile(np.linspace(0.0, 2.5, EACH), CLASSES)
    classes = np.repeat(np.arange(CLASSES), EACH)
    points = np.column_stack([np.cos(along), np.sin(along), 0.9 * classes])
    points += 0.03 * random.standard_normal(points.shape)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    return classes, 4.0 - 8.0 * distances


def slow_flow(log_odds, query):
    """The flow by a dense inverse, with the query as a stored shape."""
    count = len(log_odds)
    weights = np.zeros((count, count))
    for i in range(count):
        nearest = sorted((j for j in range(count) if j != i), key=lambda j: -log_odds[i, j])[:LINKED]
        for j in nearest:
            best, last = log_odds[i, nearest[0]], log_odds[i, nearest[-1]]
            fall = DECAY * (best - log_odds[i, j]) / min(best - last, WIDEST)
            weights[i, j] = expit(log_odds[i, j]) * np.exp(-fall)
    weights = (weights + weights.T) / 2
    degrees = weights.sum(axis=1)
    inverse = np.linalg.inv(np.eye(count) - DAMPING * weights / np.sqrt(np.outer(degrees, degrees)))
    return inverse[query]


def test_a_query_that_is_not_stored_has_the_flow_of_a_stored_one():
    _, log_odds = collection()
    rows = nearest_rows(log_odds)
    for query in (0, 11, 40):
        others = np.arange(len(log_odds)) != query
        around = NeighbourRows(*(array[others] for array in (rows.shapes, rows.neighbours, rows.log_odds)))
        found = query_flow(*around.links(), log_odds[query, others])
        assert found == pytest.approx(slow_flow(log_odds, query)[others], abs=1e-8)


def test_one_candidate_has_the_flow_of_two_linked_shapes():
    rows = NeighbourRows(np.array([5]), np.full((1, 3), NOBODY), np.full((1, 3), -np.inf))
    flow = query_flow(*rows.links(), np.array([logit(0.3)]))
    # Both degrees equal the weight of the link, whatever it is.
    assert flow == pytest.approx([DAMPING / (1.0 - DAMPING**2)])


def test_the_far_end_of_a_class_comes_before_nearer_shapes_of_others():
    shares = np.empty((5, 2))
    for seed, found in enumerate(shares):
        classes, log_odds = collection(seed)
        for kind, scores in enumerate((log_odds, all_contextual_scores(log_odds))):
            others = np.where(np.eye(len(scores), dtype=bool), -np.inf, scores)
            first = np.argsort(-others, axis=1)[:, : EACH - 1]
            found[kind] = (classes[first] == classes[:, None]).mean()
    assert shares[:, 0].max() < 0.85
    assert shares[:, 1].mean() > 0.98


@pytest.mark.parametrize("spread", [0.01, 0.1, WIDEST])
def test_links_of_any_spread_of_log_odds_weigh_alike(spread):
    weights = link_weights(40.0 + spread * np.array([[0.0, -0.25, -1.0, -np.inf]]))
    assert weights[0] == pytest.approx([1.0, np.exp(-DECAY / 4), np.exp(-DECAY), 0.0])


def test_links_that_are_missing_make_no_difference_to_others():
    """As in a map of shapes that pass a filter."""
    weights = link_weights(np.array([[-np.inf, 40.0, -np.inf, 39.0], [-np.inf] * 4]))
    assert weights == pytest.approx(np.array([[0.0, 1.0, 0.0, np.exp(-DECAY)], [0.0] * 4]))


def test_the_order_of_the_shapes_makes_no_difference():
    _, log_odds = collection(1)
    order = np.random.default_rng(2).permutation(len(log_odds))
    scores = all_contextual_scores(log_odds)
    assert all_contextual_scores(log_odds[np.ix_(order, order)]) == pytest.approx(
        scores[np.ix_(order, order)], abs=1e-6
    )


def test_without_a_graph_the_order_is_that_of_the_log_odds():
    log_odds = np.random.default_rng(3).normal(0.0, 4.0, 30)
    rows = NeighbourRows(np.arange(30), np.full((30, 2), NOBODY), np.full((30, 2), -np.inf))
    assert (np.argsort(contextual_scores(rows, log_odds)) == np.argsort(log_odds)).all()


def test_a_shape_without_log_odds_is_last_and_carries_the_flow():
    # Shape 1 was not compared with the query, and links it to shape 2; shape 3 has no link.
    rows = NeighbourRows(
        np.arange(4), np.array([[1], [2], [1], [NOBODY]]), np.array([[3.0], [3.0], [3.0], [-np.inf]])
    )
    log_odds = np.array([2.0, -np.inf, -9.0, -9.0])
    scores = contextual_scores(rows, log_odds)
    assert scores[1] == -np.inf
    assert scores[0] > scores[2] > scores[3] + 1.0


def test_neighbours_that_are_not_around_have_no_links():
    rows = NeighbourRows(
        np.array([3, 7]), np.array([[7, 12], [NOBODY, NOBODY]]), np.array([[1.0, 0.5], [-np.inf] * 2])
    )
    links, log_odds = rows.links()
    assert links.tolist() == [[1, NOBODY], [NOBODY, NOBODY]]
    assert log_odds.tolist() == [[1.0, -np.inf], [-np.inf, -np.inf]]
    nothing = NeighbourRows(np.empty(0, np.int64), np.empty((0, 2), np.int64), np.empty((0, 2)))
    assert contextual_scores(nothing, np.empty(0)).shape == (0,)


def test_rows_have_the_nearest_others():
    _, log_odds = collection()
    rows = nearest_rows(log_odds)
    assert rows.neighbours.shape == (len(log_odds), NEIGHBOURS)
    assert not (rows.neighbours == rows.shapes[:, None]).any()
    assert (np.diff(rows.log_odds, axis=1) <= 0.0).all()
    others = np.where(np.eye(len(log_odds), dtype=bool), -np.inf, log_odds)
    assert rows.log_odds[:, -1] == pytest.approx(np.sort(others, axis=1)[:, -NEIGHBOURS])


def test_shapes_beyond_the_most_nodes_keep_their_order(monkeypatch):
    _, log_odds = collection()
    monkeypatch.setattr("core.ranking.diffusion.MOST_NODES", 10)
    scores = all_contextual_scores(log_odds)[0]
    beyond = np.argsort(-log_odds[0])[11:]
    assert scores[beyond] == pytest.approx(np.log(1e-6) + LOG_ODDS_WEIGHT * log_odds[0, beyond])
