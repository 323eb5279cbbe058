"""The normal frame: it moves with the surface, whatever its tessellation."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import _mean_power, normal_frame, second_moments
from tests.core.shapes import (
    SAME_SHAPE,
    area,
    areas,
    blob,
    box,
    icosphere,
    joined,
    prism,
    rectangle,
    scaled,
    shifted,
    subdivided,
    turned,
    vertices_shuffled,
)


def normalised(mesh):
    mesh = clean(mesh).mesh
    return normal_frame(mesh).apply(mesh.vertices)


def midpoint_second_moments(mesh):
    """Centre and second moments about it by the edge midpoints' rule, which is exact for both."""
    corners, shares = mesh.vertices[mesh.faces], areas(mesh) / area(mesh)
    middles = 0.5 * (corners + np.roll(corners, 1, axis=1))
    centre = shares @ middles.mean(axis=1)
    middles = middles - centre
    return centre, np.einsum("f,fci,fcj->ij", shares, middles, middles) / 3.0


def with_moments(mesh, *wanted):
    """The mesh stretched along its principal axes until its second moments are as wanted."""
    for _ in range(60):
        centre, second = midpoint_second_moments(mesh)
        found, axes = np.linalg.eigh(second)
        mesh = Mesh((mesh.vertices - centre) @ axes * np.sqrt(np.sort(wanted) / found), mesh.faces)
    return mesh


def test_a_box_has_the_moments_of_its_closed_form():
    a, b, c = 3.0, 2.0, 1.0
    whole = 2 * (a * b + b * c + c * a)
    # Two faces at +- a/2; four across which x is spread evenly.
    squared = [
        (2 * q * r * p**2 / 4 + (whole - 2 * q * r) * p**2 / 12) / whole
        for p, q, r in ((a, b, c), (b, c, a), (c, a, b))
    ]
    frame = normal_frame(shifted(box(a, b, c), (5, -6, 7)))
    np.testing.assert_allclose(frame.centre, [5, -6, 7], atol=1e-12)
    assert frame.scale == pytest.approx(np.sqrt(sum(squared)))
    np.testing.assert_allclose(np.abs(frame.axes), np.eye(3), atol=1e-12)


def test_a_sphere_has_its_radius_for_scale():
    assert normal_frame(icosphere(4, 2.5)).scale == pytest.approx(2.5, rel=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_the_normal_frame_is_centred_of_unit_radius_and_ordered_by_spread(seed):
    mesh = shifted(scaled(turned(blob(seed), seed), 42.0), (300, -200, 100))
    frame = normal_frame(mesh)
    inside = Mesh(frame.apply(mesh.vertices), mesh.faces)
    centre, second = midpoint_second_moments(inside)
    np.testing.assert_allclose(centre, 0.0, atol=1e-12)
    spread = np.diag(second)
    np.testing.assert_allclose(second, np.diag(spread), atol=1e-12)
    assert spread.sum() == pytest.approx(1.0)
    assert spread[0] > spread[1] > spread[2]
    np.testing.assert_allclose(normal_frame(inside).axes, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(frame.axes @ frame.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame.axes) == pytest.approx(1.0)


def test_invert_undoes_apply():
    frame = normal_frame(blob())
    points = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(frame.invert(frame.apply(points)), points, atol=1e-12)


TIED = {
    "no ties": blob(),
    "y and z tied": with_moments(blob(), 2.0, 1.0, 1.0),
    "y and z nearly tied": with_moments(blob(), 2.0, 1.0, 0.99),
    "x and y tied": with_moments(blob(), 2.0, 2.0, 1.0),
    "x and y nearly tied": with_moments(blob(), 2.0, 1.985, 1.0),
    "all tied": with_moments(blob(), 1.0, 1.0, 1.0),
    "all nearly tied": with_moments(blob(), 1.01, 1.005, 1.0),
}


@pytest.mark.parametrize("change", SAME_SHAPE.values(), ids=SAME_SHAPE)
@pytest.mark.parametrize("mesh", TIED.values(), ids=TIED)
def test_a_shape_without_symmetry_has_one_normal_form(mesh, change):
    expected, found = normalised(mesh), normalised(change(mesh))
    distance, index = cKDTree(expected).query(found)
    assert distance.max() < 1e-9
    assert len(np.unique(index)) == len(expected)


@pytest.mark.parametrize("mesh", TIED.values(), ids=TIED)
def test_it_does_not_hang_on_how_finely_the_surface_is_cut(mesh):
    expected, found = normal_frame(mesh), normal_frame(subdivided(mesh))
    np.testing.assert_allclose(found.centre, expected.centre, atol=1e-12)
    np.testing.assert_allclose(found.axes, expected.axes, atol=1e-9)
    assert found.scale == pytest.approx(expected.scale)


SYMMETRIC = {
    "cube": box(1, 1, 1),
    "square bar": box(3, 1, 1),
    "square tile": box(3, 3, 1),
    "bar": box(3, 2, 1),
    "three-sided prism": prism(3, 2.0),
    "five-sided prism": prism(5, 3.0),
    "seven-sided ring": prism(7, 0.2),
    "star of five": prism(10, 0.5, radii=(1.0, 0.4)),
    "star of four": prism(8, 4.0, radii=(1.0, 0.4)),
    "tube": prism(24, 5.0),
    "sheet": rectangle(3, 2, 3, 2),
    "square sheet": rectangle(2, 2, 2, 2),
    "dumbbell": joined(shifted(icosphere(1), (2, 0, 0)), shifted(icosphere(1), (-2, 0, 0))),
}


@pytest.mark.parametrize("mesh", SYMMETRIC.values(), ids=SYMMETRIC)
def test_a_symmetric_shape_has_one_normal_form_up_to_its_symmetry(mesh):
    expected = cKDTree(normalised(mesh))
    for seed in range(10):
        found = normalised(vertices_shuffled(turned(mesh, seed), seed))
        assert expected.query(found)[0].max() < 1e-9


def test_a_square_is_not_told_by_which_way_its_diagonals_run():
    # The middles of two triangles lean along the diagonal; the square does not.
    for extents in ((3, 1, 1), (3, 3, 1), (1, 1, 1)):
        one, other = box(*extents), Mesh(box(*extents).vertices * [1, 1, -1], box(*extents).faces)
        assert cKDTree(normalised(one)).query(normalised(other))[0].max() < 1e-9


def test_a_ball_has_a_frame_all_the_same():
    frame = normal_frame(turned(icosphere(3), 5))
    np.testing.assert_allclose(frame.axes @ frame.axes.T, np.eye(3), atol=1e-12)


def test_a_lean_decides_the_sign_of_an_axis():
    # An arrow along x: heavier, and shorter, at its head.
    arrow = joined(box(4, 0.2, 0.2), shifted(box(0.5, 1.5, 0.6), (2, 0, 0)))
    for seed in range(8):
        turn = Rotation.random(random_state=seed).as_matrix()
        frame = normal_frame(Mesh(arrow.vertices @ turn.T, arrow.faces))
        tail = normal_frame(arrow).apply(np.array([[-2.0, 0, 0]]))
        np.testing.assert_allclose(frame.apply(np.array([[-2.0, 0, 0]]) @ turn.T)[0, 0], tail[0, 0])


def plain_mean_power(values, weights, order):
    """By the polynomial's recurrence over arrays; values at the corners, shape (f, 3)."""
    terms = [np.ones_like(values[:, 0]), *(np.zeros_like(values[:, 0]) for _ in range(order))]
    for corner in values.T:
        for i in range(1, order + 1):
            terms[i] = terms[i] + corner * terms[i - 1]
    return 2.0 / ((order + 1) * (order + 2)) * (weights @ terms[order]) / weights.sum()


@pytest.mark.parametrize("order", range(1, 9))
def test_compiled_powers_are_the_plain_ones(order):
    mesh = blob()
    weights = face_areas(mesh.vertices, mesh.faces)
    plane = mesh.vertices[:, 0] + 1j * mesh.vertices[:, 1]
    for values in (plane, mesh.vertices[:, 2]):
        wanted = plain_mean_power(values[mesh.faces], weights, order)
        assert _mean_power(values, mesh.faces, weights, order) == pytest.approx(wanted, rel=1e-10, abs=1e-13)


def test_compiled_second_moments_are_by_the_midpoints_rule():
    mesh = shifted(blob(), (0.3, -0.2, 0.5))
    centre, wanted = midpoint_second_moments(mesh)
    found = second_moments(mesh.vertices - centre, mesh.faces, face_areas(mesh.vertices, mesh.faces))
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-15)
