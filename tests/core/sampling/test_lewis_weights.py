"""Leverage scores and Lewis weights against dense algebra and the printed formulas."""

import math

import numpy as np
import pytest

from core.errors import ParameterError
from core.sampling.lewis_weights import lewis_weights, orthonormal_basis, printed_constants


def cloud(count=300, seed=0):
    """Points whose z is no polynomial of x and y."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * [2.0, 1.0, 0.3]
    points[:, 2] += 0.2 * np.sin(3.0 * points[:, 0]) * np.abs(points[:, 1])
    return points


def monomials(x, y, degree):
    """B of Eq. 8 one entry after the other, unscaled."""
    return np.array(
        [
            [a**i * b**j for i in range(degree + 1) for j in range(degree + 1 - i)]
            for a, b in zip(x, y, strict=True)
        ]
    )


@pytest.mark.parametrize("degree", [1, 2, 4, 6])
def test_leverage_is_the_diagonal_of_the_hat_matrix(degree):
    x, y = np.random.default_rng(degree).uniform(-1.0, 1.0, size=(2, 200))
    dense = monomials(x, y, degree)
    leverage = lewis_weights(np.column_stack([x, y, x]), degree=degree).leverage
    np.testing.assert_allclose(leverage, np.diag(dense @ np.linalg.pinv(dense)), atol=1e-9)


@pytest.mark.parametrize("degree", [1, 3, 6, 12])
def test_leverage_lies_in_the_unit_interval_and_sums_to_the_rank(degree):
    leverage = lewis_weights(cloud(), degree=degree).leverage
    assert leverage.min() >= 0.0
    assert leverage.max() <= 1.0 + 1e-12
    assert leverage.sum() == pytest.approx((degree + 1) * (degree + 2) / 2)


@pytest.mark.parametrize("degree", [2, 6])
def test_leverage_does_not_change_under_affine_maps_of_the_plane(degree):
    points = cloud()
    moved = points.copy()
    moved[:, :2] = points[:, :2] @ np.array([[1.7, -0.4], [0.9, 2.2]]) + [5.0, -3.0]
    first, second = (lewis_weights(each, degree=degree).leverage for each in (points, moved))
    np.testing.assert_allclose(first, second, atol=1e-8)


def test_dependent_columns_do_not_count_in_the_rank():
    rng = np.random.default_rng(2)
    matrix = rng.normal(size=(40, 3)) @ rng.normal(size=(3, 7))
    basis = orthonormal_basis(matrix)
    assert basis.shape == (40, 3)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(basis @ (basis.T @ matrix), matrix, atol=1e-10)


def test_points_on_a_line_have_the_rank_of_one_variable():
    x = np.linspace(-1.0, 1.0, 50)
    line = np.column_stack([x, np.full(50, 4.0), x])
    assert lewis_weights(line, degree=5).leverage.sum() == pytest.approx(6.0)


def test_printed_constants_by_hand():
    """r1 = 16 (4 + 2) d^2 (d ln 96 + ln 200), r2 = 150 * 576 d^2 / e^2 (d ln(280 / e) + ln 200)."""
    r1, r2 = printed_constants(28, 0.01)
    assert r1 == pytest.approx(96 * 784 * (28 * math.log(96) + math.log(200)))
    assert r2 == pytest.approx(86_400 * 784 / 1e-4 * (28 * math.log(28_000) + math.log(200)))
    assert r1 == pytest.approx(1.0e7, rel=0.01)
    assert r2 == pytest.approx(2.0e14, rel=0.02)


@pytest.mark.parametrize(
    "wrong",
    [
        *({"epsilon": epsilon} for epsilon in (-0.01, 0.0, 1.0 / 7.0, 1.0, float("nan"))),
        *({"degree": degree} for degree in (-1, 0, 13)),
    ],
)
def test_epsilon_and_degree_out_of_range(wrong):
    with pytest.raises(ParameterError):
        lewis_weights(cloud(), **wrong)


@pytest.mark.parametrize("degree", [2, 6])
def test_residual_is_that_of_least_squares(degree):
    points = cloud()
    dense = monomials(points[:, 0] / 8.0, points[:, 1] / 4.0, degree)
    fitted = dense @ np.linalg.lstsq(dense, points[:, 2], rcond=None)[0]
    np.testing.assert_allclose(
        lewis_weights(points, degree=degree).residual, fitted - points[:, 2], atol=1e-9
    )


def test_normalised_weights_are_the_larger_of_two_shares():
    points = cloud()
    found = lewis_weights(points)
    leverage = found.leverage / 28
    residual = found.residual**2 / (found.residual**2).sum()
    assert leverage.sum() == pytest.approx(1.0)
    assert residual.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(found.weights, np.maximum(leverage, residual), rtol=1e-10)
    assert (leverage > residual).any()
    assert (residual > leverage).any()


def test_a_surface_of_degree_five_is_fitted_exactly():
    points = cloud()
    x, y = points[:, 0], points[:, 1]
    points[:, 2] = 0.3 * x**5 - 0.2 * x**2 * y**3 + x * y - 0.4
    exact = lewis_weights(points, degree=6)
    assert np.abs(exact.residual).max() < 1e-9 * np.abs(points[:, 2]).max()
    np.testing.assert_allclose(exact.weights, exact.leverage / 28)
    short = lewis_weights(points, degree=4)
    assert np.abs(short.residual).max() > 0.01
    assert (short.weights > short.leverage / 15 + 1e-6).any()


@pytest.fixture(scope="module")
def many():
    """More rows than the printed r1 of a plane, about 16,400."""
    points = cloud(40_000, seed=3)
    assert printed_constants(3, 0.01)[0] == pytest.approx(16_400, rel=0.01)
    return points


def test_stage_one_fits_the_rows_that_the_draw_keeps(many):
    random = np.random.default_rng(4).random(len(many))
    found = lewis_weights(many, degree=1, random=random)
    dense = np.column_stack([np.ones(len(many)), many[:, :2]])
    leverage = np.einsum("ij,ji->i", dense, np.linalg.pinv(dense))
    probability = np.minimum(1.0, leverage / 3 * printed_constants(3, 0.01)[0])
    kept = random < probability
    assert 0.2 < kept.mean() < 0.5
    root = 1.0 / np.sqrt(probability[kept])
    solution = np.linalg.lstsq(dense[kept] * root[:, None], many[kept, 2] * root, rcond=None)[0]
    np.testing.assert_allclose(found.residual, dense @ solution - many[:, 2], atol=1e-10)
    np.testing.assert_allclose(found.leverage, leverage, atol=1e-12)
    share = found.residual**2 / (found.residual**2).sum()
    np.testing.assert_allclose(found.weights, np.maximum(leverage / 3, share))


def test_stage_one_is_near_the_whole_fit_and_depends_on_the_draw(many):
    whole = lewis_weights(many, degree=1)
    draws = [
        lewis_weights(many, degree=1, random=np.random.default_rng(seed).random(len(many))) for seed in (5, 6)
    ]
    least = (whole.residual**2).sum()
    for drawn in draws:
        assert least < (drawn.residual**2).sum() < 1.01 * least
    assert np.abs(draws[0].residual - draws[1].residual).max() > 1e-6


def test_printed_form_of_a_row_less_probable_than_one(many):
    random = np.random.default_rng(7).random(len(many))
    found = lewis_weights(many, degree=1, normalise=False, epsilon=0.1, random=random)
    r1, r2 = printed_constants(3, 0.1)
    share = found.residual**2 / (found.residual**2).sum()
    np.testing.assert_allclose(
        found.weights, np.maximum(np.minimum(1.0, found.leverage / 3 * r1), share * r2), rtol=1e-10
    )


def test_the_draw_is_not_asked_where_every_row_is_certain():
    points = cloud()
    drawn = lewis_weights(points, random=np.ones(len(points)))
    np.testing.assert_array_equal(drawn.residual, lewis_weights(points).residual)
