"""Iterative closest points, against motions that are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.gallery import make_shape
from core.mesh.mesh import Mesh
from service.studies.baselines.icp import POINTS, closest_motion, compare, describe


@pytest.fixture(scope="module")
def cloud() -> np.ndarray:
    """A cloud without symmetry, centred, along its principal axes."""
    random = np.random.default_rng(1)
    points = random.normal(size=(300, 3)) * [3.0, 2.0, 1.0] + random.exponential(size=(300, 3))
    points -= points.mean(axis=0)
    return points @ np.linalg.svd(points, full_matrices=False)[2].T


@pytest.mark.parametrize("half_turn", ["x", "y", "z"])
def test_a_turned_copy_is_found_from_any_start(cloud: np.ndarray, half_turn: str) -> None:
    turn = Rotation.from_euler(half_turn, np.pi) * Rotation.from_euler("xyz", [0.1, -0.1, 0.05])
    assert closest_motion(turn.apply(cloud) + np.array([0.1, 0.0, -0.1]), cloud) < 1e-6


def test_a_mirrored_copy_is_found_only_where_mirrors_count(cloud: np.ndarray) -> None:
    mirrored = cloud * [1.0, 1.0, -1.0]
    assert closest_motion(mirrored, cloud, mirrored=True) < 1e-6
    assert closest_motion(mirrored, cloud) > 0.1


def test_the_distance_counts_both_ways() -> None:
    # Each point of the first lies on one of the second; of the second, one in five lies 1 from the first.
    first = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    second = np.vstack([first, [[0.0, 0, 1]], [[0, 0, -1]]])
    away = np.sqrt(2.0)
    expected = np.sqrt(0.5 * (0.0 + 2.0 * away**2 / 6.0))
    assert closest_motion(first, second) == pytest.approx(expected)


def test_points_lie_on_the_surface_evenly_by_area() -> None:
    # A box of 4 x 2 x 1: its faces have 8, 8, 4, 4, 2, 2 of 28 parts of the area.
    corners = np.array([[x, y, z] for x in (0, 4) for y in (0, 2) for z in (0, 1)], dtype=float)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    points = describe(Mesh(corners, faces))
    assert points.shape == (POINTS, 3)
    scale = np.abs(points).max(axis=0) / [2.0, 1.0, 0.5]
    assert scale == pytest.approx(np.full(3, scale[0]), rel=1e-9)
    on = np.isclose(np.abs(points) / scale, [2.0, 1.0, 0.5])
    assert on.any(axis=1).all()
    assert on.mean(axis=0) == pytest.approx([4 / 28, 8 / 28, 16 / 28], abs=0.06)


def test_the_same_shape_turned_is_nearer_than_another() -> None:
    cup, pliers = make_shape("cup", 0), make_shape("pliers", 0)
    turn = Rotation.from_euler("xyz", [0.7, 1.9, -0.4]).as_matrix()
    turned = Mesh(3.0 * cup.vertices @ turn.T + 1.0, cup.faces)
    same, other = compare(describe(cup), [describe(turned), describe(pliers)])
    assert same < 0.15
    assert other > 2.0 * same
