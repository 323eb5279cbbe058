"""Distances to the seventh neighbour, against sorting."""

import numpy as np
import pytest

from core.ranking.local_density import ENOUGH, NEIGHBOUR, neighbour_distances

TYPICAL = 0.3


def test_the_seventh_of_many_is_that_of_a_sort() -> None:
    distances = np.random.default_rng(0).random((5, ENOUGH + 20))
    distances[2, :4] = np.inf
    found = neighbour_distances(distances, TYPICAL)
    assert found == pytest.approx(np.sort(distances, axis=1)[:, NEIGHBOUR - 1])


def test_few_shapes_tell_little() -> None:
    assert neighbour_distances(np.empty((2, 0)), TYPICAL).tolist() == [TYPICAL, TYPICAL]
    assert neighbour_distances(np.full((1, 3), np.inf), TYPICAL).tolist() == [TYPICAL]
    few = neighbour_distances(np.array([[0.1, 0.2, np.inf]]), TYPICAL)
    assert few == pytest.approx([0.2 ** (2 / ENOUGH) * TYPICAL ** (1 - 2 / ENOUGH)])
    half = neighbour_distances(np.full((1, ENOUGH // 2), 0.1), TYPICAL)
    assert half == pytest.approx([np.sqrt(0.1 * TYPICAL)])


def test_copies_of_a_shape_give_a_small_positive_density() -> None:
    found = neighbour_distances(np.zeros((1, 2 * ENOUGH)), TYPICAL)
    assert 0.0 < found[0] < 1e-3
