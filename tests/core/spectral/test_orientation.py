"""Signed areas of regions in the spectral domain: against gradients, and under maps and mirror images."""

import numpy as np
import pytest

from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.spectral.orientation import face_signs, orientation_agreement, quantised_areas, signed_areas
from tests.core.shapes import icosphere, joined, rectangle

TURNED = [0, 2, 1]


def signs_of(mesh):
    return face_signs(mesh, face_areas(mesh.vertices, mesh.faces))


def test_signed_areas_are_integrals_of_cross_products_of_gradients():
    mesh = icosphere(2)
    functions = np.random.default_rng(0).normal(size=(len(mesh.vertices), 3))
    regions = np.arange(len(mesh.vertices)) % 5
    found = signed_areas(functions, mesh.faces, np.ones(len(mesh.faces)), regions, 5)
    expected = np.zeros((5, 3, 3))
    for face in mesh.faces:
        corners = mesh.vertices[face]
        edges = corners[1:] - corners[0]
        normal = np.cross(*edges)
        area = 0.5 * np.linalg.norm(normal)
        # Gradients in the plane of the face, from the differences along two of its edges.
        gradients = np.linalg.pinv(edges) @ (functions[face[1:]] - functions[face[0]])
        crossed = np.cross(gradients.T[:, None], gradients.T[None, :]) @ (normal / np.linalg.norm(normal))
        for corner in face:
            expected[regions[corner]] += area / 3.0 * crossed
    np.testing.assert_allclose(found, expected[:, *np.tril_indices(3, -1)], atol=1e-12)


def test_normals_of_closed_surfaces_point_outward():
    ball = icosphere(1)
    inward = Mesh(ball.vertices + 9.0, ball.faces[:, TURNED])
    assert set(signs_of(ball)) == {1.0}
    assert set(signs_of(inward)) == {-1.0}
    half = len(ball.faces)
    signs = signs_of(joined(ball, inward))
    assert set(signs[:half]) == {1.0}
    assert set(signs[half:]) == {-1.0}


def test_an_open_surface_keeps_its_faces():
    sheet = rectangle(1.0, 1.0, 5, 5)
    for faces in (sheet.faces, sheet.faces[:, TURNED]):
        assert set(signs_of(Mesh(sheet.vertices, faces))) == {1.0}


def test_faces_turned_every_way_have_no_orientation():
    ball = icosphere(2)
    faces = ball.faces.copy()
    faces[::3] = faces[::3][:, TURNED]
    mixed = Mesh(ball.vertices, faces)
    assert signs_of(mixed) is None
    # A small component without orientation does not count.
    speck = Mesh(0.1 * mixed.vertices + 9.0, mixed.faces)
    signs = signs_of(joined(ball, speck))
    assert set(signs[: len(faces)]) == {1.0}
    assert set(signs[len(faces) :]) == {0.0}


def agreement(first, second, rotation):
    return orientation_agreement(first, second[None], rotation[None])[0]


def test_a_map_keeps_orientation_and_a_mirror_image_reverses_it():
    ball = icosphere(2)
    random = np.random.default_rng(1)
    functions = random.normal(size=(len(ball.vertices), 5))
    rotation = np.linalg.qr(random.normal(size=(5, 5)))[0]
    regions = np.arange(len(ball.vertices)) % 7
    signs = np.ones(len(ball.faces))
    first = signed_areas(functions, ball.faces, signs, regions, 7)
    second = signed_areas(functions @ rotation, ball.faces, signs, regions, 7)
    mirrored = signed_areas(functions @ rotation, ball.faces[:, TURNED], signs, regions, 7)
    assert agreement(first, second, rotation) == pytest.approx(1.0)
    assert agreement(first, mirrored, rotation) == pytest.approx(-1.0)
    assert abs(agreement(first, np.roll(second, 1, axis=0), rotation)) < 0.8
    assert agreement(first, np.zeros_like(second), rotation) == 0.0
    both = orientation_agreement(first, np.stack([second, mirrored]), np.stack([rotation, rotation]))
    np.testing.assert_allclose(both, [1.0, -1.0])


def test_bytes_hold_the_areas_up_to_a_scale():
    areas = np.random.default_rng(2).normal(size=(9, 6))
    found = quantised_areas(areas)
    assert (found.shape, found.dtype) == ((9, 6), np.int8)
    assert np.abs(found).max() == 127
    np.testing.assert_allclose(found / 127.0, areas / np.abs(areas).max(), atol=0.5 / 127.0)
    assert not quantised_areas(np.zeros((2, 3))).any()
