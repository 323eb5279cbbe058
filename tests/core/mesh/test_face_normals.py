"""Normals of triangles against closed forms."""

import numpy as np

from core.mesh.cleaning import face_areas
from core.mesh.mesh import face_normals
from tests.core.shapes import icosphere


def test_normals_of_a_sphere_point_outwards_and_have_length_one():
    ball = icosphere(3)
    corners = ball.vertices[ball.faces]
    normals = face_normals(corners)
    centres = corners.mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(normals, centres / np.linalg.norm(centres, axis=1, keepdims=True), atol=0.02)


def test_normals_that_are_not_unit_are_twice_as_long_as_the_area():
    ball = icosphere(2)
    lengths = np.linalg.norm(face_normals(ball.vertices[ball.faces], unit=False), axis=1)
    np.testing.assert_allclose(lengths, 2.0 * face_areas(ball.vertices, ball.faces), rtol=1e-12)


def test_the_other_direction_of_a_face_has_the_opposite_normal():
    corners = np.array([[(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 3.0, 0.0)]])
    for unit, length in ((True, 1.0), (False, 6.0)):
        assert face_normals(corners, unit=unit).tolist() == [[0.0, 0.0, length]]
        assert face_normals(corners[:, ::-1], unit=unit).tolist() == [[0.0, 0.0, -length]]


def test_a_triangle_without_area_has_the_normal_zero():
    line = np.array([[(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2.0, 2.0, 2.0)]])
    assert face_normals(line).tolist() == [[0.0, 0.0, 0.0]]
