"""Families: chains join, and a single link between two groups does not."""

import numpy as np

from core.ranking.diffusion import NEIGHBOURS, NOBODY, NeighbourRows, nearest_rows
from core.ranking.families import families


def grouped(labels: list[int], *links: tuple[int, int]) -> np.ndarray:
    """Log odds of all pairs: high within a label and for some links, low else."""
    count = len(labels)
    log_odds = np.where(np.equal.outer(labels, labels), 5.0, -5.0)
    log_odds += 1e-3 * np.random.default_rng(0).random((count, count))
    for first, second in links:
        log_odds[first, second] = log_odds[second, first] = 9.0
    return log_odds


def partition(log_odds: np.ndarray, least: float = 0.0) -> list[int]:
    return families(nearest_rows(log_odds), least).tolist()


def test_groups_are_families_whatever_one_pair_looks_like():
    labels = [0] * 6 + [1] * 6 + [2] * 6
    found = partition(grouped(labels, (0, 6)))
    assert found == labels
    assert partition(grouped(labels), least=6.0) == list(range(18))


def test_a_chain_of_neighbours_is_one_family():
    places = np.arange(60.0)
    log_odds = 6.0 - np.abs(places[:, None] - places)
    assert partition(log_odds) == [0] * 60
    gap = np.where(places < 30, places, places + 20)
    assert partition(6.0 - np.abs(gap[:, None] - gap)) == [0] * 30 + [1] * 30


def test_shapes_without_rows_are_alone():
    nobody, impossible = np.full((3, NEIGHBOURS), NOBODY), np.full((3, NEIGHBOURS), -np.inf)
    assert families(NeighbourRows(np.array([4, 6, 9]), nobody, impossible), 0.0).tolist() == [0, 1, 2]
    assert families(NeighbourRows(np.empty(0, np.int64), nobody[:0], impossible[:0]), 0.0).tolist() == []


def test_two_shapes_alone_are_a_family():
    assert partition(np.array([[0.0, 3.0], [3.0, 0.0]])) == [0, 0]
    assert partition(np.array([[0.0, 3.0], [3.0, 0.0]]), least=4.0) == [0, 1]
