"""Splines' matrices from one inversion, against those made one by one."""

import numpy as np
import pytest

from core.matching import thin_plate_spline as module
from core.matching.thin_plate_spline import compiled_spline_operators, spline_operators
from tests.core.matching.clouds import cloud


@pytest.mark.parametrize("stiffness", [0.1, 1.0, 100.0])
@pytest.mark.parametrize(("m", "k", "first"), [(32, 6, 3), (100, 10, 10), (12, 10, 3), (40, 3, 2), (9, 2, 2)])
def test_the_matrices_are_those_made_one_by_one(m, k, first, stiffness, monkeypatch):
    monkeypatch.setattr(module, "spline_operators", None)
    for seed in range(5):
        points = cloud(np.random.default_rng(seed), m, k).astype(np.float64)
        found = compiled_spline_operators(points, first, stiffness)
        assert found.shape == (k - first + 1, m, m)
        assert found == pytest.approx(spline_operators(points, first, stiffness), abs=1e-6)
        assert np.array_equal(found, found.transpose(0, 2, 1))
        assert np.abs(found).max() <= 1.0


def flat():
    points = cloud(np.random.default_rng(1), 30, 6).astype(np.float64)
    points[:, 4:] = 0.0
    return points


def line():
    points = np.zeros((30, 6))
    points[:, 0] = np.linspace(-1, 1, 30)
    return points


def twice():
    points = cloud(np.random.default_rng(2), 30, 6).astype(np.float64)
    points[:, 5] = points[:, 4]
    return points


def two_places():
    return np.repeat(cloud(np.random.default_rng(3), 2, 6).astype(np.float64), 15, axis=0)


@pytest.mark.parametrize("made", [flat, line, twice, two_places])
def test_points_that_leave_the_affine_part_open_are_solved_the_other_way(made):
    points = made()
    found = compiled_spline_operators(points, 3, 1.0)
    assert found == pytest.approx(spline_operators(points, 3, 1.0).astype(np.float64), abs=1e-6)
    assert np.isfinite(found).all()


def test_points_that_coincide_in_pairs():
    points = np.repeat(cloud(np.random.default_rng(4), 16, 6).astype(np.float64), 2, axis=0)
    assert compiled_spline_operators(points, 3, 1.0) == pytest.approx(
        spline_operators(points, 3, 1.0), abs=1e-6
    )
