"""ShapeDNA, against the spectrum of the sphere and what does not change a spectrum."""

import numpy as np
import pytest
from trimesh.creation import icosphere

from core.gallery import make_shape
from core.mesh.mesh import Mesh
from service.studies.baselines.shapedna import VALUES, compare, describe


def sphere(radius: float) -> Mesh:
    made = icosphere(subdivisions=4)
    return Mesh(radius * made.vertices, made.faces)


def test_a_sphere_has_its_known_spectrum() -> None:
    # On the unit sphere the eigenvalue l (l + 1) comes 2 l + 1 times; the area is 4 pi.
    known = np.repeat([2.0, 6.0, 12.0], [3, 5, 7]) * 4.0 * np.pi / np.arange(1, VALUES + 1)
    assert describe(sphere(1.0)) == pytest.approx(known, rel=0.01)


def test_size_does_not_matter() -> None:
    assert describe(sphere(1000.0)) == pytest.approx(describe(sphere(0.001)), rel=1e-9)


def test_pose_and_place_do_not_matter() -> None:
    cup = make_shape("cup", 0)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    moved = Mesh(cup.vertices @ turn.T + np.array([5.0, -3.0, 1.0]), cup.faces)
    assert describe(moved) == pytest.approx(describe(cup), rel=1e-6)


def test_distances_are_euclidean_and_tell_classes_apart() -> None:
    cup, other, pliers = (describe(make_shape(*which)) for which in (("cup", 0), ("cup", 1), ("pliers", 0)))
    found = compare(cup, [cup, other, pliers])
    assert found == pytest.approx([0.0, np.linalg.norm(cup - other), np.linalg.norm(cup - pliers)])
    assert found[1] < found[2]


def test_loose_and_broken_parts_have_a_spectrum() -> None:
    cup = make_shape("cup", 0)
    descriptor_distance = Mesh(
        np.vstack([cup.vertices, cup.vertices + np.array([9.0, 0.0, 0.0])]),
        np.vstack([cup.faces[::2], cup.faces + len(cup.vertices)]),
    )
    assert np.isfinite(describe(descriptor_distance)).all()
