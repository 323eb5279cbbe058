"""The polar factor against SciPy's, matrices that do not determine one included; the map of paired clouds."""

import numpy as np
import pytest
from scipy.linalg import svdvals
from scipy.optimize import linprog

from core.matching.kernels.procrustes import EXACT, LANES, ROUGH, fit_rotations, nearest_rotations
from tests.core.matching.clouds import cloud
from tests.core.matching.reference import (
    cross_covariance_reference,
    fit_rotation_reference,
    nearest_rotation_reference,
)


def factor(matrix, steps=EXACT):
    """Trace and polar factor, float64, of a matrix rounded to float32, which is one of a few side by side."""
    k = len(matrix)
    matrices = np.zeros((k, -(-k // 4) * 4, LANES), dtype=np.float32)
    matrices[:, :k, 3] = matrix
    matrices[:, :k, 5] = 2.0 * np.eye(k)
    before = matrices.copy()
    found, traces = np.full(matrices.shape, np.nan, dtype=np.float32), np.empty(LANES, dtype=np.float32)
    nearest_rotations(matrices, steps, found, traces)
    assert np.array_equal(matrices, before)
    assert not found[:, k:].any()
    assert not found[..., [0, 1, 2, 4, 6, 7]].any()
    assert found[:, :k, 5] == pytest.approx(np.eye(k), abs=4e-4)
    assert traces[[0, 5, 7]] == pytest.approx([0.0, 2.0 * k, 0.0], rel=4e-4)
    return float(traces[3]), found[:, :k, 3].astype(np.float64)


def of_singular_values(seed, values):
    """A matrix of float32 numbers; the values are of it before it is rounded."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(len(values),) * 2))[0] for _ in range(2))
    return (left * values @ right).astype(np.float32).astype(np.float64)


def best_step(least, most):
    """The odd polynomial of degree 5 nearest to 1 on an interval, and its error, by linear programming."""
    x = np.union1d(np.geomspace(least, most, 2000), np.linspace(least, most, 2000))
    powers = np.stack([x, x**3, x**5], axis=1)
    error = np.ones((len(x), 1))
    rows, bounds = np.block([[powers, -error], [-powers, -error]]), np.concatenate([x**0, -(x**0)])
    *found, deviation = linprog([0, 0, 0, 1], rows, bounds, bounds=[(None, None)] * 3 + [(0, None)]).x
    return found, deviation


def applied(steps, x):
    for a, b, c in steps.astype(np.float64):
        x = a * x + b * x**3 + c * x**5
    return x


@pytest.mark.parametrize(("steps", "least", "count"), [(ROUGH, 3e-4, 7), (EXACT, 1e-4, 8)])
def test_each_step_is_the_best_polynomial_for_what_the_ones_before_leave(steps, least, count):
    low, high = least, 1.0
    for step in steps[: count - 1]:
        expected, deviation = best_step(low, high * 1.005)
        assert step == pytest.approx(expected, rel=1e-3)
        low, high = 1.0 - deviation, 1.0 + deviation


@pytest.mark.parametrize(("steps", "least", "error"), [(ROUGH, 3e-4, 3e-4), (EXACT, 1e-4, 1e-6)])
def test_the_steps_take_singular_values_to_one_and_lesser_ones_to_no_more(steps, least, error):
    assert applied(steps, np.geomspace(least, 1.001, 10000)) == pytest.approx(1.0, abs=error)
    lesser = applied(steps, np.geomspace(1e-9, least, 10000))
    assert (np.diff(lesser) > 0.0).all()
    assert lesser[0] < 1e-3


@pytest.mark.parametrize("steps", [ROUGH, EXACT])
@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("k", [1, 3, 10, 16, 17, 33])
def test_the_factor_is_the_plain_one(k, scale, steps):
    for seed in range(10):
        matrix = (scale * np.random.default_rng(seed).normal(size=(k, k))).astype(np.float32)
        trace, found = factor(matrix, steps)
        expected_trace, expected = nearest_rotation_reference(matrix.astype(np.float64), steps)
        sigma = svdvals(matrix.astype(np.float64))
        assert found == pytest.approx(expected, abs=4e-7 * k * max(sigma[0] / sigma[-1], 10.0))
        assert trace == pytest.approx(expected_trace, rel=3e-6)


def test_a_map_that_mirrors_is_kept():
    mirror = np.diag([1.0, -1.0, 1.0])
    assert factor(mirror)[1] == pytest.approx(mirror, abs=1e-6)


@pytest.mark.parametrize("rank", [1, 2, 5, 9])
@pytest.mark.parametrize("k", [2, 6, 10])
def test_a_singular_matrix_determines_the_factor_on_its_range_and_the_rest_goes_to_nothing(k, rank):
    for seed in range(10):
        values = np.where(np.arange(k) < rank, np.linspace(3, 1, k), 0.0)
        matrix = of_singular_values(seed, values)
        trace, found = factor(matrix)
        assert trace == pytest.approx(values.sum(), rel=1e-5)
        left, _, right = np.linalg.svd(matrix)
        kept = min(rank, k)
        assert found @ right[:kept].T == pytest.approx(left[:, :kept], abs=1e-4)
        # The traces of rounding, made up to 1e5 times greater.
        assert np.abs(found @ right[kept:].T).max(initial=0.0) < 0.02


@pytest.mark.parametrize("k", [1, 3, 10])
def test_the_factor_of_a_zero_matrix_is_zero(k):
    trace, found = factor(np.zeros((k, k)))
    assert trace == 0.0
    assert not found.any()


def test_undetermined_directions_hardly_depend_on_rounding():
    for seed in range(10):
        matrix = of_singular_values(seed, np.array([3, 2, 1, 1e-6, 0.0, 0.0]))
        shaken = matrix + 1e-7 * np.random.default_rng(seed).normal(size=matrix.shape)
        assert factor(shaken)[1] == pytest.approx(factor(matrix)[1], abs=0.05)


def rotated(points, targets, blocks):
    """`fit_rotations` of the pairs' cross-products: the last of as many maps as fill lanes twice."""
    nothing = np.empty((0, points.shape[1]))
    cross, first, second = cross_covariance_reference(points, targets, nothing, nothing, blocks)
    k = len(cross) // blocks
    own = np.array([cross[low : low + k, low : low + k] for low in range(0, len(cross), k)])
    covariances, *squares = (
        np.stack([0.0 * array] * 8 + [array]).astype(np.float32) for array in (own, first, second)
    )
    rotations, scores = np.zeros((9, *cross.shape), dtype=np.float32), np.full(9, np.nan)
    fit_rotations(covariances, *squares, EXACT, rotations, scores)
    assert not rotations[:8].any()
    assert not scores[:8].any()
    return scores[8], rotations[8]


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize("k", [2, 3, 7, 12])
def test_the_map_of_paired_clouds_is_the_plain_one(k, blocks):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        points, targets = (
            np.concatenate([cloud(rng, 60, k) for _ in range(blocks)], axis=1).astype(np.float64)
            for _ in range(2)
        )
        targets = targets + points
        score, rotation = rotated(points, targets, blocks)
        expected, plain = fit_rotation_reference(points, targets, blocks)
        assert score == pytest.approx(expected, abs=1e-6)
        assert rotation == pytest.approx(plain, abs=2e-5)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_a_cloud_that_was_turned_and_moved_and_grew_is_turned_back(scale):
    rng = np.random.default_rng(1)
    points = cloud(rng, 50, 10).astype(np.float64)
    truth = np.linalg.qr(rng.normal(size=(10, 10)))[0]
    score, rotation = rotated(points * scale, 2.0 * scale * points @ truth + scale * rng.normal(size=10), 1)
    assert score == pytest.approx(1.0, abs=1e-6)
    assert rotation == pytest.approx(truth, abs=1e-5)


def test_a_domain_that_is_one_point_counts_nothing():
    rng = np.random.default_rng(2)
    points = np.concatenate([cloud(rng, 30, 4), np.zeros((30, 4))], axis=1).astype(np.float64)
    for given in ((points, points), (points, points[:, [4, 5, 6, 7, 0, 1, 2, 3]])):
        score, rotation = rotated(*given, 2)
        expected, plain = fit_rotation_reference(*given, 2)
        assert score == pytest.approx(expected, abs=1e-6)
        assert rotation == pytest.approx(plain, abs=1e-5)
    assert rotated(points, points, 2)[0] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("distinct", [1, 2, 4])
def test_clouds_of_few_places_have_the_plain_correlation(distinct):
    """The rest of the map is not determined."""
    rng = np.random.default_rng(3)
    points = cloud(rng, 40, 8).astype(np.float64)
    targets = cloud(rng, 5, 8).astype(np.float64)[rng.integers(distinct, size=40)]
    score, rotation = rotated(points, targets, 1)
    assert score == pytest.approx(fit_rotation_reference(points, targets, 1)[0], abs=1e-6)
    assert svdvals(rotation).max() < 1.0 + 1e-5
