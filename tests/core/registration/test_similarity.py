"""Similarity transforms of paired points, closest points, and the smooth surface of a mesh."""

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold
from numpy.testing import assert_allclose

from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.registration.curved_surface import CurvedSurface, curved_surface
from core.registration.similarity import bend, best_similarity
from core.sampling.surface_samples import closest_points, surface_samples
from tests.gallery import make_shape


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


@pytest.mark.parametrize("sign", [1, -1])
def test_a_bend_is_the_way_of_the_part_that_moves(sign: int) -> None:
    """A quarter of a rod is turned about its end by 90 degrees: nine of ten points move less than its top."""
    points = np.zeros((101, 3))
    points[:, 0] = np.linspace(0.0, 1.0, 101)
    points[::2, 1], points[1::2, 2] = 0.05, 0.05
    bent = points.copy()
    free = points[:, 0] > 0.75
    bent[free, 0], bent[free, 1] = 0.75 - points[free, 1], points[free, 0] - 0.75
    moved = 1.7 * (bent - [0.1, 0.2, 0.3]) @ orthogonal(2, sign).T
    assert bend(points, moved) == pytest.approx(1.7 * np.quantile(np.linalg.norm(bent - points, axis=1), 0.9))
    assert bend(points, 1.7 * points @ orthogonal(2, sign).T) == pytest.approx(0.0, abs=1e-9)


def test_points_are_spread_by_area_on_a_surface_of_unit_area() -> None:
    made = surface_samples(make_shape("cup", 0))
    areas = 0.5 * np.linalg.norm(
        np.cross(made.corners[:, 1] - made.corners[:, 0], made.corners[:, 2] - made.corners[:, 0]), axis=1
    )
    assert areas.sum() == pytest.approx(1.0)
    counts = np.bincount(made.faces, minlength=len(areas))
    assert (np.abs(counts - len(made.points) * areas) <= 1.0 + 1e-6).all()
    assert_allclose(closest_points(made, made.points), made.points, atol=1e-9)


def of(solid: Manifold) -> CurvedSurface:
    made = solid.to_mesh64()
    mesh = Mesh(np.array(made.vert_properties[:, :3]), made.tri_verts.astype(np.int64))
    return curved_surface(clean(mesh).mesh, np.zeros(3), 1.0)


def on_curved(surface: CurvedSurface) -> tuple[np.ndarray, np.ndarray]:
    """Random points of the triangles with a chord error, flat and smooth."""
    draws = np.random.default_rng(0)
    faces = draws.choice(np.flatnonzero(surface.chord > 0.0), 5000)
    shares = draws.dirichlet([1.0, 1.0, 1.0], len(faces))
    return np.einsum("nc,ncx->nx", shares, surface.corners[faces]), surface.at(shares, faces)[0]


@pytest.mark.parametrize("count", [12, 24, 64])
def test_the_chord_error_of_a_cylinder_is_that_of_a_circle(count: int) -> None:
    surface = of(Manifold.cylinder(10.0, 2.0, circular_segments=count))
    assert surface.chord.max() == pytest.approx(2.0 * (1.0 - np.cos(np.pi / count)), rel=0.02)
    flat, smooth = (np.abs(np.hypot(each[:, 0], each[:, 1]) - 2.0).max() for each in on_curved(surface))
    assert smooth < 0.1 * flat


def test_smooth_points_of_a_sphere_are_nearer_to_it_than_its_triangles() -> None:
    surface = of(Manifold.sphere(1.0, 48))
    flat, smooth = (np.abs(np.linalg.norm(each, axis=1) - 1.0) for each in on_curved(surface))
    assert smooth.mean() < 0.4 * flat.mean()
    assert flat.max() < 1.5 * surface.spread.max()


def test_planes_have_no_chord_error_and_a_wedge_is_no_curve() -> None:
    box = of(Manifold.cube((3.0, 2.0, 1.0)))
    assert box.chord.max() == 0.0
    assert len(box.sharp) == 12
    wedge = of(CrossSection([[(0, 0), (5, 0), (5, 3), (0, 4)]]).extrude(1.0))
    assert wedge.chord.max() == 0.0
    assert len(wedge.sharp) == 12


def test_a_fillet_leaves_the_normals_of_the_planes_beside_it() -> None:
    arc = [(9.0 + np.sin(a), 4.0 + np.cos(a)) for a in np.linspace(0.0, np.pi / 2, 7)]
    solid = CrossSection([[(0, 0), *[(float(x), float(y)) for x, y in arc[::-1]], (0, 5)]]).extrude(6.0)
    surface = of(solid)
    plane = np.abs(surface.flat[:, 1]) > 1.0 - 1e-9
    tilts = np.einsum("fcx,fx->fc", surface.normals[plane], surface.flat[plane])
    assert tilts.min() > np.cos(np.radians(0.5))


@pytest.mark.parametrize("holes", [0, 1, 3])
def test_through_holes_are_counted(holes: int) -> None:
    solid = Manifold.cube((30.0, 10.0, 2.0))
    for hole in range(holes):
        solid -= Manifold.cylinder(4.0, 2.0, circular_segments=16).translate((5.0 + 9.0 * hole, 5.0, -1.0))
    assert of(solid).handles == holes
    assert of(solid).volume == pytest.approx(solid.volume(), rel=1e-6)


def test_an_open_surface_has_no_number_of_through_holes() -> None:
    open_mesh = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.2]], dtype=float),
        np.array([[0, 1, 2], [1, 3, 2]]),
    )
    assert curved_surface(open_mesh, np.zeros(3), 1.0).handles is None
