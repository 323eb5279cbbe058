"""Alignment: the assignment against SciPy's, the alternation against its plain form, planted maps."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from core.alignment import align, align_reference, assign, fit, fit_reference


def orthogonal(rng, size, *, reflection=False):
    """A random orthogonal matrix whose determinant is 1, or -1 for a reflection."""
    matrix = np.linalg.qr(rng.normal(size=(size, size)))[0]
    if (np.linalg.det(matrix) < 0.0) != reflection:
        matrix[:, 0] *= -1.0
    return matrix


def costs(kind, rows, columns, seed):
    rng = np.random.default_rng(seed)
    if kind == "uniform":
        return rng.random((rows, columns))
    if kind == "negative":
        return rng.normal(size=(rows, columns)) - 3.0
    if kind == "ties":
        return rng.integers(0, 3, size=(rows, columns)).astype(float)
    if kind == "constant":
        return np.full((rows, columns), 2.5)
    if kind == "wide range":
        return 10.0 ** rng.uniform(-6, 6, size=(rows, columns))
    points, targets = rng.normal(size=(rows, 3)), rng.normal(size=(columns, 3))
    return ((points[:, None] - targets[None]) ** 2).sum(axis=2)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (2, 2), (5, 5), (40, 40), (100, 100), (8, 9), (30, 70)])
@pytest.mark.parametrize("kind", ["uniform", "negative", "ties", "constant", "wide range", "distances"])
def test_the_assignment_costs_what_scipys_does(kind, size):
    for seed in range(5):
        cost = costs(kind, *size, seed)
        chosen = assign(cost)
        assert chosen.shape == (size[0],)
        assert len(np.unique(chosen)) == size[0]
        assert chosen.min() >= 0
        assert chosen.max() < size[1]
        least = cost[linear_sum_assignment(cost)].sum()
        assert cost[np.arange(size[0]), chosen].sum() == pytest.approx(least, rel=1e-12, abs=1e-9)


def test_rows_and_columns_repeated_are_assigned_at_least_cost():
    rng = np.random.default_rng(3)
    cost = np.repeat(np.repeat(rng.random((6, 6)), 5, axis=0), 5, axis=1)
    chosen = assign(cost)
    assert sorted(chosen) == list(range(30))
    assert cost[np.arange(30), chosen].sum() == pytest.approx(cost[linear_sum_assignment(cost)].sum())


def test_a_planted_permutation_is_assigned():
    rng = np.random.default_rng(4)
    order = rng.permutation(60)
    cost = 1.0 + rng.random((60, 60))
    cost[np.arange(60), order] = rng.random(60) * 0.5
    assert (assign(cost) == order).all()


@pytest.mark.parametrize("rounds", [1, 2, 4, 20])
@pytest.mark.parametrize(("m", "n", "k"), [(30, 30, 3), (25, 40, 6), (50, 50, 4), (3, 9, 2)])
def test_align_is_its_reference(m, n, k, rounds):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        points, targets = rng.normal(size=(m, k)), rng.normal(size=(n, k)) + 0.3
        start = orthogonal(rng, k, reflection=bool(seed % 2))
        cc, matches, rotation = align(points, targets, start, rounds, 1)
        expected_cc, expected_matches, expected_rotation = align_reference(points, targets, start, rounds, 1)
        assert cc == pytest.approx(expected_cc, abs=1e-9)
        assert (matches == expected_matches).all()
        assert rotation == pytest.approx(expected_rotation, abs=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_a_permuted_slightly_turned_copy_is_found_from_the_identity(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(60, 3)) * [3.0, 2.0, 1.0]
    turn = Rotation.from_rotvec(0.1 * rng.normal(size=3) / np.sqrt(3.0)).as_matrix()
    order = rng.permutation(60)
    cc, matches, rotation = align(points, (points @ turn)[order], np.eye(3), 50, 1)
    assert cc == pytest.approx(1.0, abs=1e-12)
    assert (order[matches] == np.arange(60)).all()
    assert rotation == pytest.approx(turn, abs=1e-9)


def test_a_scaled_copy_is_matched_to_itself_and_correlates_fully():
    rng = np.random.default_rng(8)
    points = rng.normal(size=(40, 4))
    points -= points.mean(axis=0)
    cc, matches, _ = align(points, 1.2 * points, np.eye(4), 10, 1)
    assert cc == pytest.approx(1.0, abs=1e-12)
    assert (matches == np.arange(40)).all()


def test_a_cloud_that_is_one_point_correlates_with_nothing():
    cc, matches, _ = align(np.zeros((5, 2)), np.random.default_rng(1).normal(size=(6, 2)), np.eye(2), 4, 1)
    assert cc == 0.0
    assert len(np.unique(matches)) == 5


@pytest.mark.parametrize("reflection", [False, True])
@pytest.mark.parametrize("k", [2, 3, 6])
def test_procrustes_finds_a_planted_map(k, reflection):
    rng = np.random.default_rng(k)
    points = rng.normal(size=(20, k))
    planted = orthogonal(rng, k, reflection=reflection)
    _, found = fit(points, points @ planted + rng.normal(size=k), np.arange(20), 1)
    assert found == pytest.approx(planted, abs=1e-10)
    assert np.linalg.det(found) == pytest.approx(-1.0 if reflection else 1.0)


def test_no_orthogonal_map_lies_closer_than_procrustes():
    rng = np.random.default_rng(6)
    points, targets = rng.normal(size=(15, 3)), rng.normal(size=(15, 3))
    points, targets = points - points.mean(axis=0), targets - targets.mean(axis=0)
    _, found = fit(points, targets, np.arange(15), 1)
    assert found.T @ found == pytest.approx(np.eye(3), abs=1e-12)
    least = ((points @ found - targets) ** 2).sum()
    for i in range(200):
        other = orthogonal(rng, 3, reflection=bool(i % 2))
        assert ((points @ other - targets) ** 2).sum() >= least


@pytest.mark.parametrize("blocks", [1, 2, 3])
def test_fit_is_its_reference(blocks):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        points, targets = rng.normal(size=(20, 6)), rng.normal(size=(30, 6)) + 1.0
        matches = rng.permutation(30)[:20]
        cc, rotation = fit(points, targets, matches, blocks)
        expected, expected_rotation = fit_reference(points, targets, matches, blocks)
        assert cc == pytest.approx(expected, abs=1e-12)
        assert rotation == pytest.approx(expected_rotation, abs=1e-9)


@pytest.mark.parametrize("rounds", [1, 4])
def test_two_domains_are_aligned_as_the_reference_does(rounds):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        points, targets = rng.normal(size=(25, 6)), rng.normal(size=(28, 6))
        start = fit_reference(points, targets, rng.permutation(28)[:25], 2)[1]
        cc, matches, rotation = align(points, targets, start, rounds, 2)
        expected_cc, expected_matches, expected_rotation = align_reference(points, targets, start, rounds, 2)
        assert cc == pytest.approx(expected_cc, abs=1e-9)
        assert (matches == expected_matches).all()
        assert rotation == pytest.approx(expected_rotation, abs=1e-7)


def test_domains_turned_apart_are_brought_back_by_maps_of_their_own():
    rng = np.random.default_rng(9)
    points = rng.normal(size=(30, 6))
    turned = np.concatenate(
        [points[:, :3] @ orthogonal(rng, 3, reflection=True), points[:, 3:] * 2.0], axis=1
    )
    cc, rotation = fit(points, turned, np.arange(30), 2)
    assert cc == pytest.approx(1.0, abs=1e-12)
    assert (rotation[:3, 3:] == 0.0).all()
    assert (rotation[3:, :3] == 0.0).all()
    assert fit(points, turned, np.arange(30), 1)[0] < 0.99


def test_a_domain_that_is_one_point_counts_nothing():
    points = np.c_[np.random.default_rng(3).normal(size=(10, 2)), np.zeros((10, 2))]
    assert fit(points, points, np.arange(10), 2)[0] == pytest.approx(0.5)
