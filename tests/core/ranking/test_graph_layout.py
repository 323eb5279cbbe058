"""The layout of the graph of neighbours: what pulls, what pushes, and what makes no difference."""

import numpy as np
import pytest

from core.ranking.diffusion import NOBODY, NeighbourRows, nearest_rows
from core.ranking.graph_layout import EXTENT, graph_positions

CLUSTERS, EACH = 5, 12


def clusters():
    """Links within clusters alone, and positions at the start that mix the clusters."""
    random = np.random.default_rng(0)
    labels = np.repeat(np.arange(CLUSTERS), EACH)
    log_odds = np.where(labels[:, None] == labels, 4.0, -12.0) + random.normal(0.0, 0.5, (len(labels),) * 2)
    return labels, nearest_rows((log_odds + log_odds.T) / 2.0).links(), random.normal(size=(len(labels), 2))


def test_shapes_of_a_cluster_come_together():
    labels, links, start = clusters()
    same = (labels[:, None] == labels) & ~np.eye(len(labels), dtype=bool)
    nearest = []
    for positions in (start, graph_positions(*links, start)):
        distances = np.linalg.norm(positions[:, None] - positions, axis=2) + 1e9 * np.eye(len(labels))
        nearest.append(same[np.arange(len(labels)), distances.argmin(axis=1)].mean())
    assert nearest[0] < 0.5
    assert nearest[1] == 1.0


def test_equal_arguments_give_equal_positions_whatever_the_unit_of_the_start():
    _, links, start = clusters()
    positions = graph_positions(*links, start)
    assert (graph_positions(*links, start) == positions).all()
    assert graph_positions(*links, 1024.0 * start) == pytest.approx(positions, abs=1e-6)


def test_two_linked_shapes_come_nearer_and_two_others_part():
    start = np.array([[0.0, 0.0], [1.0, 0.0]])
    nobody, impossible = np.full((2, 1), NOBODY), np.full((2, 1), -np.inf)
    linked = graph_positions(np.array([[1], [0]]), np.full((2, 1), 9.0), start)
    apart = graph_positions(nobody, impossible, start)
    assert np.linalg.norm(linked[1] - linked[0]) < EXTENT < 2.0 * EXTENT < np.linalg.norm(apart[1] - apart[0])


def test_shapes_whose_nearest_neighbours_are_left_out_are_laid_out():
    links = NeighbourRows(np.arange(2), np.array([[9, 1], [9, 0]]), np.array([[9.0, 8.0]] * 2)).links()
    start = np.array([[0.0, 0.0], [1.0, 0.0]])
    alone = [array[:, 1:] for array in links]
    assert (graph_positions(*links, start) == graph_positions(*alone, start)).all()


def test_one_shape_and_equal_positions_are_laid_out():
    nobody, impossible = np.full((3, 1), NOBODY), np.full((3, 1), -np.inf)
    positions = graph_positions(nobody, impossible, np.zeros((3, 2)))
    assert np.isfinite(positions).all()
    assert len(np.unique(positions, axis=0)) == 3
    assert np.isfinite(graph_positions(nobody[:1], impossible[:1], np.zeros((1, 2)))).all()
