"""The similarity transform of paired points, and samples of a surface."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from core.gallery import make_shape
from core.registration.similarity import best_similarity
from core.sampling.surface_samples import closest_on_triangles, closest_points, surface_samples


def orthogonal(seed: int, sign: int) -> np.ndarray:
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn[0] *= sign * np.sign(np.linalg.det(turn))
    return turn


@pytest.mark.parametrize("sign", [1, -1])
def test_the_similarity_of_paired_points_is_the_one_they_were_moved_by(sign: int) -> None:
    points = np.random.default_rng(1).normal(size=(20, 3))
    turn = orthogonal(2, sign)
    target = 1.7 * points @ turn.T + [1.0, 2.0, 3.0]
    found = best_similarity(points, target, sign=sign, scaled=True)
    assert found.scale == pytest.approx(1.7)
    assert_allclose(found.rotation, turn, atol=1e-12)
    assert_allclose(found.apply(points), target, atol=1e-12)
    assert_allclose(found.invert(target), points, atol=1e-12)


def test_the_determinant_is_the_one_asked_for_and_no_rotation_nearby_is_better() -> None:
    draws = np.random.default_rng(3)
    points, target = draws.normal(size=(2, 15, 3))
    for sign in (1, -1):
        found = best_similarity(points, target, sign=sign, scaled=False)
        assert np.linalg.det(found.rotation) == pytest.approx(sign)
        assert found.scale == 1.0
        least = ((found.apply(points) - target) ** 2).sum()
        for _ in range(50):
            axis = 0.1 * draws.normal(size=3)
            skew = np.cross(np.eye(3), axis)
            turn = np.linalg.solve(np.eye(3) + skew, np.eye(3) - skew) @ found.rotation
            other = points @ turn.T + target.mean(axis=0) - turn @ points.mean(axis=0)
            assert ((other - target) ** 2).sum() > least


def test_the_closest_point_of_a_triangle_is_that_of_a_search_over_its_inside() -> None:
    draws = np.random.default_rng(4)
    for corners, point in zip(draws.normal(size=(40, 3, 3)), draws.normal(size=(40, 3)), strict=True):
        (found,) = closest_on_triangles(corners[None], np.zeros((1, 1), dtype=np.int64), point[None])
        searched = minimize(
            lambda shares, corners=corners, point=point: float(((shares @ corners - point) ** 2).sum()),
            np.full(3, 1.0 / 3.0),
            bounds=[(0.0, 1.0)] * 3,
            constraints={"type": "eq", "fun": lambda shares: shares.sum() - 1.0},
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert_allclose(found, searched.x @ corners, atol=1e-4)


def test_points_are_spread_by_area_on_a_surface_of_unit_area() -> None:
    made = surface_samples(make_shape("cup", 0))
    areas = 0.5 * np.linalg.norm(
        np.cross(made.corners[:, 1] - made.corners[:, 0], made.corners[:, 2] - made.corners[:, 0]), axis=1
    )
    assert areas.sum() == pytest.approx(1.0)
    counts = np.bincount(made.faces, minlength=len(areas))
    assert (np.abs(counts - len(made.points) * areas) <= 1.0 + 1e-6).all()
    assert_allclose(closest_points(made, made.points), made.points, atol=1e-9)
