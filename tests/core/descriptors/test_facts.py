"""Boundary ratios, reliabilities and global descriptors of surfaces where they are known."""

from dataclasses import replace

import numpy as np
import pytest

from core.descriptors.facts import (
    LEAST_VOLUME,
    boundary_ratio,
    global_descriptors,
    gyration_radii,
    intrinsic_reliability,
    signed_volume,
)
from core.evaluation.perturbation import cut_part, remove_discs
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT, INCOMPLETE
from core.pipeline import Pipeline
from tests.core.shapes import FACTS, box, icosphere, joined, prism, rectangle, scaled, shifted, soup, turned
from tests.gallery import make_shape
from tests.studies.perturbation import make_soup


def open_share(mesh: Mesh) -> float:
    mesh = clean(mesh).mesh
    return boundary_ratio(mesh, float(face_areas(mesh.vertices, mesh.faces).sum()))


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e6])
def test_the_two_rims_of_a_tube_bound_its_two_ends(scale: float) -> None:
    mesh = prism(200, 4.0)
    assert open_share(Mesh(scale * mesh.vertices, mesh.faces)) == pytest.approx(2.0 / (2.0 * 4.0), rel=1e-3)


def test_a_closed_surface_has_none_and_a_sheet_no_more_than_its_area() -> None:
    assert open_share(make_shape("cup", 0)) == 0.0
    triangle = Mesh(np.array([[0, 0, 0], [2, 0, 0], [1, np.sqrt(3), 0]]), np.array([[0, 1, 2]]))
    assert open_share(triangle) == 1.0


@pytest.mark.parametrize(("smaller", "counts"), [(4.0, False), (0.5, True)])
def test_the_rims_of_a_model_of_several_pieces_do_not_count(smaller: float, counts: bool) -> None:
    both = joined(prism(50, 4.0), shifted(prism(50, smaller), [10.0] * 3))
    assert (open_share(both) > INCOMPLETE) is counts


def test_the_rims_of_loose_bits_do_not_count() -> None:
    body = make_shape("octopus", 0)
    size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
    bits = Mesh(0.02 * size * np.random.default_rng(0).random((60, 3)), np.arange(60).reshape(20, 3))
    assert open_share(joined(body, shifted(bits, [size] * 3))) == 0.0
    assert open_share(cut_part(body, 0.1, 0)) > 0.0
    assert open_share(make_soup(body, 0.02, 0)) == 0.0


def test_a_part_looks_incomplete_and_a_few_small_holes_do_not() -> None:
    for label in ("person", "octopus", "chair"):
        mesh = make_shape(label, 0)
        assert open_share(cut_part(mesh, 0.3, 0)) > INCOMPLETE
        assert 0.0 < open_share(remove_discs(mesh, 0.002, 0)) < INCOMPLETE


def test_it_is_among_the_facts_of_an_embedding() -> None:
    part = cut_part(make_shape("person", 0), 0.4, 1)
    assert Pipeline(DEFAULT).embed(part).facts.boundary_ratio == pytest.approx(open_share(part))


def test_a_closed_manifold_surface_of_one_piece_is_reliable() -> None:
    assert intrinsic_reliability(FACTS) == 1.0


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ({"boundary_edges": 3}, 1.0 / 2.0),
        ({"nonmanifold_edges": 3}, 1.0 / 2.0),
        ({"components": 3}, 1.0 / 2.0),
        ({"boundary_edges": 6, "nonmanifold_edges": 3, "components": 5}, 1.0 / 6.0),
    ],
)
def test_each_fault_lowers_it(faults: dict[str, int], expected: float) -> None:
    """3 of 150 edges are 2 %."""
    assert intrinsic_reliability(replace(FACTS, **faults)) == pytest.approx(expected)


def test_a_polygon_soup_is_hardly_reliable() -> None:
    soup = Pipeline(DEFAULT).embed(make_soup(icosphere(2), 0.1, 0))
    assert intrinsic_reliability(soup.facts) < 0.05


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
def test_place_pose_size_and_side_do_not_count(seed):
    mesh = make_shape("hand", seed)
    moved = shifted(scaled(turned(mesh, seed), 37.0), [5.0, -200.0, 11.0])
    for other in (moved, Mesh(mesh.vertices, mesh.faces[:, ::-1])):
        np.testing.assert_allclose(global_descriptors(other), global_descriptors(mesh), atol=1e-9)


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


@pytest.mark.parametrize("outwards", [True, False])
def test_the_radii_of_gyration_of_a_box_are_its_sides_over_the_root_of_twelve(outwards):
    mesh = turned(box(4, 2, 1), 5)
    faces = mesh.faces if outwards else mesh.faces[:, ::-1]
    found = gyration_radii(Mesh(10.0 * mesh.vertices + [300.0, -200.0, 100.0], faces))
    assert found == pytest.approx(np.array([40.0, 20.0, 10.0]) / 12.0**0.5, rel=1e-9)


def test_a_flat_surface_has_no_radii_of_gyration():
    assert gyration_radii(rectangle(3, 1, 2, 1)) == (0.0, 0.0, 0.0)


def test_vertices_without_faces_and_spikes_of_no_area_do_no_harm():
    mesh = box(4, 2, 1)
    lone = Mesh(np.concatenate([mesh.vertices, [[1e300, -1e300, 0.0]]]), mesh.faces)
    assert gyration_radii(lone) == pytest.approx(gyration_radii(mesh), rel=1e-9)
    spike = [[0, len(mesh.vertices), 0]]
    assert gyration_radii(Mesh(lone.vertices, np.concatenate([mesh.faces, spike]))) == (0.0, 0.0, 0.0)
