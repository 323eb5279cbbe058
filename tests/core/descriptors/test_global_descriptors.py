"""Terms of form against solids whose volumes and areas are known."""

import numpy as np
import pytest

from core.descriptors.facts import LEAST_VOLUME, global_descriptors, signed_volume
from core.gallery import make_shape
from core.mesh.mesh import Mesh
from tests.core.shapes import box, icosphere, joined, rectangle, scaled, shifted, soup, turned


def expected(area, volume, hull_volume, hull_area):
    least = LEAST_VOLUME * area**1.5
    return np.log([area**1.5 / (volume + least), (hull_volume + least) / (volume + least), area / hull_area])


def test_a_ball_is_compact_and_fills_its_hull():
    terms = global_descriptors(icosphere(4))
    np.testing.assert_allclose(
        terms, expected(4.0 * np.pi, 4.0 / 3.0 * np.pi, 4.0 / 3.0 * np.pi, 4.0 * np.pi), atol=5e-3
    )


def test_a_box_and_two_boxes_apart():
    np.testing.assert_allclose(global_descriptors(box(1.0, 2.0, 3.0)), expected(22.0, 6.0, 6.0, 22.0))
    two = joined(box(1.0, 1.0, 1.0), shifted(box(1.0, 1.0, 1.0), [2.0, 0.0, 0.0]))
    np.testing.assert_allclose(global_descriptors(two), expected(12.0, 2.0, 3.0, 14.0))


@pytest.mark.parametrize("seed", range(3))
def test_place_pose_and_size_do_not_count(seed):
    mesh = make_shape("hand", seed)
    moved = shifted(scaled(turned(mesh, seed), 37.0), [5.0, -200.0, 11.0])
    np.testing.assert_allclose(global_descriptors(moved), global_descriptors(mesh), atol=1e-9)


def test_a_surface_inside_out_has_the_same_terms():
    mesh = make_shape("cup", 1)
    np.testing.assert_allclose(
        global_descriptors(Mesh(mesh.vertices, mesh.faces[:, ::-1])), global_descriptors(mesh)
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_flat_surface_has_no_volume_and_two_sides_of_hull(seed):
    flat = turned(rectangle(2.0, 1.0, 6, 4), seed)
    np.testing.assert_allclose(global_descriptors(flat), expected(2.0, 0.0, 0.0, 4.0), atol=1e-3)


def test_one_thin_triangle_has_finite_terms():
    sliver = Mesh(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-5, 0.0]]), np.array([[0, 1, 2]]))
    assert np.isfinite(global_descriptors(sliver)).all()
    assert global_descriptors(sliver)[0] == pytest.approx(np.log(1.0 / LEAST_VOLUME))


def test_a_soup_is_nearly_the_surface_and_an_open_one_is_finite():
    mesh = make_shape("teddy", 0)
    np.testing.assert_allclose(
        global_descriptors(soup(mesh, shrink=0.98)), global_descriptors(mesh), atol=0.1
    )
    heights = mesh.vertices[mesh.faces][:, :, 2].mean(axis=1)
    half = Mesh(mesh.vertices, mesh.faces[heights > np.median(heights)])
    assert np.isfinite(global_descriptors(half)).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_closed_surfaces_volume_is_the_same_about_any_point(seed):
    mesh = shifted(turned(box(1.0, 2.0, 3.0), seed), np.random.default_rng(seed).normal(size=3))
    assert signed_volume(mesh.vertices, mesh.faces) == pytest.approx(6.0, rel=1e-12)
    assert signed_volume(mesh.vertices, mesh.faces[:, ::-1]) == pytest.approx(-6.0, rel=1e-12)
