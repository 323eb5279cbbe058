"""The thin-plate spline against Eqs. 14-16 and its two limits, and its compiled operators."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from core.errors import ParameterError
from core.matching import thin_plate_spline as module
from core.matching.thin_plate_spline import (
    compiled_spline_operators,
    mean_pair_distance,
    smoother,
    spline_operators,
    tps_kernel,
)
from tests.core.matching.clouds import cloud as decaying_cloud
from tests.core.matching.clouds import degenerate

DIMENSIONS = [2, 3, 6]


def cloud(count, dimensions, seed=0):
    return np.random.default_rng(seed).normal(size=(count, dimensions))


def bordered(source, targets, beta):
    """w and t of Eq. 16 by the whole matrix."""
    count, dimensions = source.shape
    kernel = np.zeros((count, count))
    for i in range(count):
        for j in range(count):
            if i != j:
                square = float(((source[i] - source[j]) ** 2).sum())
                kernel[i, j] = square * np.log(square)
    affine = np.column_stack([np.ones(count), source])
    corner = np.zeros((dimensions + 1, dimensions + 1))
    matrix = np.block([[kernel + beta * np.eye(count), affine], [affine.T, corner]])
    solution = np.linalg.solve(matrix, np.vstack([targets, np.zeros((dimensions + 1, targets.shape[1]))]))
    return solution[:count], solution[count:]


def test_kernel_by_hand():
    origin = np.zeros((1, 2))
    radii = np.array([0.0, 0.1, 1.0, np.exp(0.5), 10.0])
    points = np.column_stack([radii, np.zeros(5)])
    expected = [[0.0, 0.01 * np.log(0.01), 0.0, np.e, 100.0 * np.log(100.0)]]
    np.testing.assert_allclose(tps_kernel(origin, points), expected, atol=1e-12)


def test_mean_pair_distance():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    assert mean_pair_distance(square) == pytest.approx((4.0 + 2.0 * np.sqrt(2.0)) / 6.0)
    points = cloud(30, 4)
    assert mean_pair_distance(points) == pytest.approx(pdist(points).mean())


@pytest.mark.parametrize("dimensions", DIMENSIONS)
def test_a_large_beta_leaves_the_affine_least_squares_fit(dimensions):
    source, targets = cloud(40, dimensions, 5), cloud(40, 2, 6)
    affine = np.column_stack([np.ones(40), source])
    expected = affine @ np.linalg.lstsq(affine, targets, rcond=None)[0]
    np.testing.assert_allclose(smoother(source, 1e9) @ targets, expected, atol=1e-6)


@pytest.mark.parametrize("beta", [0.0, 0.01, 1.0, 50.0, 1e4])
@pytest.mark.parametrize("dimensions", DIMENSIONS)
def test_values_are_those_of_the_bordered_system(dimensions, beta):
    source, targets = cloud(35, dimensions, 7), cloud(35, 4, 8)
    w, t = bordered(source, targets, beta)
    expected = tps_kernel(source, source) @ w + np.column_stack([np.ones(35), source]) @ t
    np.testing.assert_allclose(smoother(source, beta) @ targets, expected, atol=1e-8)


@pytest.mark.parametrize("beta", [-1e-9, -3.0, float("nan")])
def test_a_beta_out_of_range(beta):
    with pytest.raises(ParameterError):
        smoother(cloud(10, 2), beta)


@pytest.mark.parametrize("dimensions", DIMENSIONS)
def test_too_few_points(dimensions):
    with pytest.raises(ParameterError):
        smoother(cloud(dimensions + 1, dimensions), 1.0)
    smoother(cloud(dimensions + 2, dimensions), 1.0)


@pytest.mark.parametrize("dimensions", DIMENSIONS)
@pytest.mark.parametrize("seed", range(6))
def test_coinciding_points_need_a_positive_beta(dimensions, seed):
    source = cloud(30, dimensions, seed)
    source[17] = source[4]
    with pytest.raises(ParameterError):
        smoother(source, 0.0)
    warped = smoother(source, 0.5) @ cloud(30, 2, 99)
    np.testing.assert_allclose(warped[17], warped[4], atol=1e-9)


@pytest.mark.parametrize("stiffness", [0.1, 100.0])
@pytest.mark.parametrize(("m", "k", "first"), [(32, 6, 3), (100, 10, 10), (12, 10, 3), (40, 3, 2), (9, 2, 2)])
def test_the_matrices_are_those_made_one_by_one(m, k, first, stiffness, monkeypatch):
    monkeypatch.setattr(module, "spline_operators", None)
    for seed in range(2):
        points = decaying_cloud(seed, m, k).astype(np.float64)
        found = compiled_spline_operators(points, first, stiffness)
        assert found.shape == (k - first + 1, m, m)
        assert found == pytest.approx(spline_operators(points, first, stiffness), abs=1e-6)
        assert np.array_equal(found, found.transpose(0, 2, 1))
        assert np.abs(found).max() <= 1.0


DEGENERATE = degenerate(30, 6)
DEGENERATE["one coordinate twice"] = decaying_cloud(2, 30, 6)[:, [0, 1, 2, 3, 4, 4]]


@pytest.mark.parametrize("cloud", DEGENERATE.values(), ids=DEGENERATE)
def test_points_that_leave_the_affine_part_open_are_solved_the_other_way(cloud):
    points = np.ascontiguousarray(cloud, dtype=np.float64)
    found = compiled_spline_operators(points, 3, 1.0)
    assert found == pytest.approx(spline_operators(points, 3, 1.0).astype(np.float64), abs=1e-6)
    assert np.isfinite(found).all()
