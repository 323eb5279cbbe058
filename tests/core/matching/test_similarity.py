"""Scores of paired points: bounds, closed forms and orders."""

import numpy as np
import pytest

from core.matching.similarity import correlation, effective_distance, effective_pairs, squared_difference


def test_the_correlation_of_one_coordinate_is_pearsons():
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=(2, 30, 1))
    expected = np.corrcoef(first[:, 0], second[:, 0])[0, 1]
    assert correlation(first, second) == pytest.approx(expected, abs=1e-14)


def test_shifts_and_positive_scales_leave_the_correlation():
    rng = np.random.default_rng(2)
    first, second = rng.normal(size=(2, 20, 3))
    plain = correlation(first, second)
    assert correlation(3.0 * first + [1, 2, 3], 0.2 * second - 5.0) == pytest.approx(plain, abs=1e-12)
    assert correlation(-2.0 * first, second) == pytest.approx(-plain, abs=1e-12)
    assert correlation(first, 7.0 * first + 1.0) == pytest.approx(1.0, abs=1e-14)
    assert correlation(first, -0.5 * first + 1.0) == pytest.approx(-1.0, abs=1e-14)


def test_a_cloud_that_is_one_point_correlates_with_nothing():
    points = np.random.default_rng(4).normal(size=(6, 3))
    assert correlation(np.ones((6, 3)), points) == 0.0
    assert correlation(points, np.zeros((6, 3))) == 0.0
    assert correlation(np.zeros((6, 3)), np.zeros((6, 3))) == 0.0


def test_the_squared_difference_is_the_root_over_the_count():
    first = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [5.0, 5.0]])
    second = np.array([[3.0, 4.0], [1.0, 0.0], [0.0, 2.0], [5.0, 17.0]])
    assert squared_difference(first, second) == pytest.approx(np.sqrt(25.0 + 144.0) / 4.0)
    assert squared_difference(second, first) == squared_difference(first, second)
    assert squared_difference(first, first) == 0.0


def test_the_effective_distance_is_a_twentieth_of_the_mean_radius():
    unit = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    assert effective_distance(unit, unit) == pytest.approx(0.05)
    assert effective_distance(3.0 * unit + 9.0, unit) == pytest.approx(0.05 * 2.0)
    uneven = np.array([[-1.0, 0.0], [-1.0, 0.0], [2.0, 0.0]])
    assert effective_distance(uneven, unit) == pytest.approx(0.05 * 0.5 * (4.0 / 3.0 + 1.0))


def test_a_target_counts_for_its_nearest_point_alone():
    distances = np.array([0.3, 0.1, 0.2, 0.9, 0.5, 0.4])
    matches = np.array([4, 4, 4, 7, 1, 1])
    assert effective_pairs(distances, matches, 0.45).tolist() == [False, True, False, False, False, True]


def test_a_pair_at_gamma_counts_and_one_past_it_does_not():
    at = 0.25
    distances = np.array([at, np.nextafter(at, 1.0)])
    assert effective_pairs(distances, np.array([0, 1]), at).tolist() == [True, False]


@pytest.mark.parametrize("seed", range(5))
def test_effective_pairs_are_one_to_one_and_as_many_as_targets_reached(seed):
    rng = np.random.default_rng(seed)
    distances, matches = np.round(rng.random(80), 1), rng.integers(0, 25, size=80)
    effective = effective_pairs(distances, matches, 0.5)
    assert len(np.unique(matches[effective])) == effective.sum()
    assert set(matches[effective]) == set(matches[distances <= 0.5])
