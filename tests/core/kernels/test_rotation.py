"""The polar factor against SciPy's, matrices that do not determine one included; the map of paired clouds."""

import numpy as np
import pytest
from scipy.linalg import polar, svdvals

from core.kernels.lanes import LANES
from core.kernels.reference import paired_reference
from core.kernels.rotation import nearest_rotation, turn, turn_reference
from tests.core.clouds import cloud


def factor(matrix, tolerance=1e-4):
    """Trace and polar factor, float64, of a matrix rounded to float32."""
    k = len(matrix)
    width = -(-k // LANES) * LANES
    padded = np.zeros((k, width), dtype=np.float32)
    padded[:, :k] = matrix
    before = padded.copy()
    found, inverse = np.empty((2, k, width), dtype=np.float32)
    trace = nearest_rotation(padded, found, inverse, np.empty(k, dtype=np.int64), tolerance)
    assert np.array_equal(padded, before)
    assert not found[:, k:].any()
    return trace, found[:, :k].astype(np.float64)


def of_singular_values(seed, values):
    """A matrix of float32 numbers; the values are of it before it is rounded."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(len(values),) * 2))[0] for _ in range(2))
    return (left * values @ right).astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("k", [1, 2, 3, 6, 10, 12, 16, 17, 33, 50])
def test_the_factor_is_scipy_s(k, scale):
    for seed in range(10):
        matrix = (scale * np.random.default_rng(seed).normal(size=(k, k))).astype(np.float32)
        trace, found = factor(matrix)
        expected, _ = polar(matrix.astype(np.float64))
        sigma = svdvals(matrix.astype(np.float64))
        assert found == pytest.approx(expected, abs=3e-7 * k * sigma[0] / sigma[-1])
        assert trace == pytest.approx(sigma.sum(), rel=3e-6)


def test_a_map_that_mirrors_is_kept():
    mirror = np.diag([1.0, -1.0, 1.0])
    assert factor(mirror)[1] == pytest.approx(mirror, abs=1e-6)


@pytest.mark.parametrize("values", [(3, 2, 0.5, 0.2), (1, 0.1, 1e-2, 1e-3), (1, 1, 1, 1e-5)])
def test_the_factor_of_a_matrix_that_is_nearly_singular(values):
    """Its error is rounding's over the least singular value; it is orthogonal all the same."""
    for seed in range(10):
        matrix = of_singular_values(seed, np.array(values, dtype=float))
        trace, found = factor(matrix)
        assert found == pytest.approx(polar(matrix)[0], abs=1e-6 * values[0] / values[-1])
        assert found @ found.T == pytest.approx(np.eye(4), abs=1e-5)
        assert trace == pytest.approx(sum(values), rel=3e-6)


@pytest.mark.parametrize("rank", [1, 2, 5, 9])
@pytest.mark.parametrize("k", [2, 6, 10])
def test_a_singular_matrix_determines_the_factor_on_its_range(k, rank):
    for seed in range(10):
        values = np.where(np.arange(k) < rank, np.linspace(3, 1, k), 0.0)
        matrix = of_singular_values(seed, values)
        trace, found = factor(matrix)
        assert trace == pytest.approx(values.sum(), rel=1e-5)
        left, _, right = np.linalg.svd(matrix)
        kept = min(rank, k)
        assert found @ right[:kept].T == pytest.approx(left[:, :kept], abs=1e-4)
        assert found @ found.T == pytest.approx(np.eye(k), abs=1e-4)


@pytest.mark.parametrize("k", [1, 3, 10])
def test_of_nothing_the_factor_is_the_identity(k):
    trace, found = factor(np.zeros((k, k)))
    assert trace == 0.0
    assert found == pytest.approx(np.eye(k), abs=1e-6)


@pytest.mark.parametrize("equal", [2, 5, 8])
def test_rows_that_are_equal_or_nothing(equal):
    """Exactly singular: a pivot of nothing."""
    matrix = np.random.default_rng(1).integers(-3, 4, size=(8, 8)).astype(np.float64)
    matrix[:equal] = matrix[0]
    matrix[-1] = 0.0
    trace, found = factor(matrix)
    assert trace == pytest.approx(svdvals(matrix).sum(), rel=1e-5)
    assert found @ found.T == pytest.approx(np.eye(8), abs=1e-4)


@pytest.mark.parametrize(("tolerance", "error"), [(1e-1, 1e-2), (3e-2, 1e-3), (1e-3, 1e-5)])
def test_the_error_left_is_of_the_order_of_the_square_of_the_tolerance(tolerance, error):
    for seed in range(20):
        matrix = of_singular_values(seed, np.linspace(3, 1, 10))
        assert np.abs(factor(matrix, tolerance)[1] - polar(matrix)[0]).max() < error


def turned(points, targets, blocks, tolerance=1e-4):
    """`turn` of the pairs' cross-products."""
    nothing = np.empty((0, points.shape[1]))
    cross, first, second = (
        array.astype(np.float32) for array in paired_reference(points, targets, nothing, nothing, blocks)
    )
    rotation = np.zeros(cross.shape, dtype=np.float32)
    return turn(cross, first, second, tolerance, rotation), rotation


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
        score, rotation = turned(points, targets, blocks)
        expected, plain = turn_reference(points, targets, blocks)
        assert score == pytest.approx(expected, abs=1e-6)
        assert rotation == pytest.approx(plain, abs=2e-5)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_a_cloud_that_was_turned_and_moved_and_grew_is_turned_back(scale):
    rng = np.random.default_rng(1)
    points = cloud(rng, 50, 10).astype(np.float64)
    truth = np.linalg.qr(rng.normal(size=(10, 10)))[0]
    score, rotation = turned(points * scale, 2.0 * scale * points @ truth + scale * rng.normal(size=10), 1)
    assert score == pytest.approx(1.0, abs=1e-6)
    assert rotation == pytest.approx(truth, abs=1e-5)


def test_a_domain_that_is_one_point_counts_nothing():
    rng = np.random.default_rng(2)
    points = np.concatenate([cloud(rng, 30, 4), np.zeros((30, 4))], axis=1).astype(np.float64)
    for given in ((points, points), (points, points[:, [4, 5, 6, 7, 0, 1, 2, 3]])):
        score, rotation = turned(*given, 2)
        expected, _ = turn_reference(*given, 2)
        assert score == pytest.approx(expected, abs=1e-6)
        assert rotation[:4, :4] @ rotation[:4, :4].T == pytest.approx(np.eye(4), abs=1e-5)
        assert not rotation[:4, 4:].any()
    assert turned(points, points, 2)[0] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("distinct", [1, 2, 4])
def test_clouds_of_few_places_have_the_plain_correlation_and_an_orthogonal_map(distinct):
    """The rest of the map is not determined."""
    rng = np.random.default_rng(3)
    points = cloud(rng, 40, 8).astype(np.float64)
    targets = cloud(rng, 5, 8).astype(np.float64)[rng.integers(distinct, size=40)]
    score, rotation = turned(points, targets, 1)
    assert score == pytest.approx(turn_reference(points, targets, 1)[0], abs=1e-6)
    assert rotation @ rotation.T == pytest.approx(np.eye(8), abs=1e-4)
