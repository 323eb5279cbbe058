"""Closest points by the tree of triangles against a search over all triangles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from core.sampling.surface_samples import closest_on_triangles
from core.sampling.triangle_tree import triangle_tree


def triangles(count: int, thin: float, seed: int) -> np.ndarray:
    """Random triangles of which some are long and thin, or a line, or a point."""
    draws = np.random.default_rng(seed)
    made = draws.normal(size=(count, 1, 3)) + 0.2 * draws.normal(size=(count, 3, 3))
    made[::3, 2] = made[::3, 1] + thin * draws.normal(size=made[::3, 2].shape)
    made[::7, 2] = made[::7, 1]
    made[::11] = made[::11, :1]
    return made


@pytest.mark.parametrize("count", [1, 2, 5, 300])
@pytest.mark.parametrize("guessed", [False, True])
def test_the_closest_point_is_the_closest_of_all_triangles(count: int, guessed: bool) -> None:
    corners = triangles(count, 1e-3, count)
    points = 2.0 * np.random.default_rng(1).normal(size=(200, 3))
    guess = np.random.default_rng(2).integers(0, count, len(points)) if guessed else None
    shares, faces = triangle_tree(corners).closest(points, guess)
    assert (shares >= -1e-12).all()
    assert_allclose(shares.sum(axis=1), 1.0)
    found = np.einsum("nc,ncx->nx", shares, corners[faces])
    everywhere = np.tile(np.arange(count), (len(points), 1))
    nearest = closest_on_triangles(corners, everywhere, points)
    gaps = [np.linalg.norm(each - points, axis=1) for each in (found, nearest)]
    assert_allclose(gaps[0], gaps[1], atol=1e-12)
