"""Frames against integrals in closed form and against a search, and where axes are equal."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from core.descriptors.view_frames import FRAMES, moments_of_plane, normalised_surface
from core.errors import DegenerateMeshError
from tests.core.shapes import blob, box, rectangle, rotation, soup, star, subdivided, turned


def same_axes(some, others):
    """Whether rows are the same axes, up to their signs."""
    return np.allclose(np.abs(some @ others.T), np.eye(3), atol=1e-6)


def test_a_surface_is_centred_and_scaled_and_its_frames_are_orthonormal():
    mesh = blob()
    surface = normalised_surface(50.0 * mesh.vertices + [7.0, -3.0, 1.0], mesh.faces)
    assert surface.areas.sum() == pytest.approx(1.0)
    assert_allclose(surface.areas @ surface.points[mesh.faces].mean(axis=1), 0.0, atol=1e-12)
    halved = subdivided(subdivided(mesh))
    fine = normalised_surface(halved.vertices, halved.faces)
    middles = fine.points[halved.faces].mean(axis=1)
    assert fine.areas @ (middles**2).sum(axis=1) == pytest.approx(1.0, rel=1e-3)
    assert surface.frames.shape == (FRAMES, 3, 3)
    for axes in surface.frames:
        assert_allclose(axes @ axes.T, np.eye(3), atol=1e-9)


def test_the_scale_of_a_square_is_that_of_its_integral():
    sheet = rectangle(2.0, 2.0, 1, 1)
    points = normalised_surface(sheet.vertices, sheet.faces).points
    # The mean of x^2 + y^2 over a square of side 2 is 2/3.
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(np.sqrt(2.0 / (2.0 / 3.0)))


@pytest.mark.parametrize("make", [lambda: box(3, 2, 1), lambda: box(2, 2, 1), lambda: box(1, 1, 1)])
def test_the_rectilinear_frame_of_a_box_is_along_its_edges(make):
    for seed in range(6):
        mesh = turned(make(), seed)
        along_edges = np.abs(normalised_surface(mesh.vertices, mesh.faces).frames[2] @ rotation(seed))
        assert_allclose(along_edges.max(axis=1), 1.0, atol=1e-6)


def test_the_rectilinear_frame_is_the_best_of_many():
    mesh = soup(blob(3))
    surface = normalised_surface(mesh.vertices, mesh.faces)

    def value(axes):
        return surface.areas @ ((surface.normals @ axes.T) ** 4).sum(axis=1)

    others = Rotation.random(500, random_state=0).as_matrix()
    assert value(surface.frames[2]) > max(value(axes) for axes in others) - 1e-3
    for angle in (-0.01, 0.01):
        for axis in np.eye(3):
            near = Rotation.from_rotvec(angle * axis).as_matrix()
            assert value(surface.frames[2] @ near) <= value(surface.frames[2])


def test_the_axes_of_a_flat_sheet_are_those_of_its_points():
    for seed in range(4):
        sheet = turned(rectangle(3, 2, 4, 4), seed)
        points, normals, _ = normalised_surface(sheet.vertices, sheet.faces).frames
        assert same_axes(points, rotation(seed).T)
        assert same_axes(normals, rotation(seed).T)


def test_frames_turn_with_the_surface():
    mesh = blob(5)
    own = normalised_surface(mesh.vertices, mesh.faces).frames
    other = turned(mesh, 9)
    for axes, moved in zip(own, normalised_surface(other.vertices, other.faces).frames, strict=True):
        assert same_axes(axes, moved @ rotation(9))


@pytest.mark.parametrize("tips", [3, 5, 6, 8])
def test_the_frames_of_a_star_point_to_a_tip(tips):
    corners = np.stack(
        [np.cos(np.arange(tips) * 2 * np.pi / tips), np.sin(np.arange(tips) * 2 * np.pi / tips)]
    )
    for seed in range(4):
        mesh = turned(star(tips), seed)
        for axes in normalised_surface(mesh.vertices, mesh.faces).frames:
            own = axes @ rotation(seed)
            in_plane = [axis for axis in own if abs(axis[2]) < 1e-6]
            assert len(in_plane) == 2
            assert np.abs(in_plane[0][:2] @ corners).max() == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("order", [2, 5, 12])
def test_moments_of_a_plane_are_those_of_many_points(order):
    """The direction in closed form against a sum over small triangles."""
    mesh = blob(2)
    corners = mesh.vertices[mesh.faces]
    areas = np.full(len(corners), 1.0 / len(corners))
    plane = np.eye(3)[:2]
    fine = corners
    for _ in range(4):
        a, b, c = fine[:, 0], fine[:, 1], fine[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        fine = np.concatenate([np.stack(part, axis=1) for part in parts])
    middles = fine.mean(axis=1) @ plane.T @ [1, 1j]
    size = (np.abs(corners @ plane.T @ [1, 1j]) ** order).mean()
    found = moments_of_plane(corners @ plane[0] + 1j * (corners @ plane[1]), areas)[order - 2]
    assert found == pytest.approx((middles**order).mean() / size, rel=5e-3)


@pytest.mark.parametrize("vertices", [[[1, 1, 1]] * 3, [[0, 0, 0], [1, 0, 0], [3, 0, 0]]])
def test_a_surface_without_area_is_an_error(vertices):
    with pytest.raises(DegenerateMeshError):
        normalised_surface(np.array(vertices, dtype=float), np.array([[0, 1, 2]]))
