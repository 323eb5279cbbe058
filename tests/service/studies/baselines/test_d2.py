"""The shape distribution D2, against the distribution of a sphere and what does not change a shape."""

import numpy as np
import pytest
from trimesh.creation import icosphere

from core.errors import DegenerateMeshError
from core.gallery import make_shape
from core.mesh.mesh import Mesh
from service.studies.baselines.d2 import BINS, RANGE, compare, describe


def test_a_sphere_has_its_known_distribution() -> None:
    # On the unit sphere the density of the distance d is d / 2 up to 2, and its mean is 4 / 3.
    ball = icosphere(subdivisions=4)
    edges = np.minimum(np.linspace(0.0, RANGE, BINS + 1) * 4.0 / 3.0, 2.0)
    assert describe(Mesh(ball.vertices, ball.faces)) == pytest.approx(np.diff(edges**2 / 4.0), abs=0.002)


def test_pose_place_and_size_do_not_matter() -> None:
    cup = make_shape("cup", 0)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    moved = Mesh(7.0 * cup.vertices @ turn.T + np.array([5.0, -3.0, 1.0]), cup.faces)
    assert compare(describe(cup), [describe(moved)])[0] < 1e-3


def test_distances_tell_classes_apart_and_are_those_of_histograms() -> None:
    cup, other, pliers = (describe(make_shape(*which)) for which in (("cup", 0), ("cup", 1), ("pliers", 0)))
    found = compare(cup, [cup, other, pliers])
    assert found == pytest.approx([0.0, np.abs(cup - other).sum(), np.abs(cup - pliers).sum()])
    assert found[1] < found[2] <= 2.0


def test_a_soup_is_described_as_its_surface() -> None:
    cup = make_shape("cup", 0)
    soup = Mesh(cup.vertices[cup.faces].reshape(-1, 3), np.arange(3 * len(cup.faces)).reshape(-1, 3))
    assert describe(soup) == pytest.approx(describe(cup), abs=1e-3)


def test_no_area_is_an_error() -> None:
    with pytest.raises(DegenerateMeshError):
        describe(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))
