"""Meshes are validated on construction; normals of their faces."""

import numpy as np
import pytest

from core.errors import MalformedMeshError, MeshError, NonFiniteCoordinatesError, NoTrianglesError
from core.mesh.mesh import Mesh, face_normals

CORNERS = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize(
    ("floats", "whole"), [(np.float64, np.int64), (np.float32, np.uint8), (np.float32, np.float32)]
)
def test_arrays_of_any_type_and_order_are_kept_and_a_later_change_is_not_seen(floats, whole, order):
    rows = [[0, 1, 2], [2, 1, 0]]
    vertices, faces = np.array(CORNERS, floats, order=order), np.array(rows, whole, order=order)
    mesh = Mesh(vertices, faces)
    vertices[0], faces[0] = np.nan, 99
    for array, kind, expected in ((mesh.vertices, np.float64, CORNERS), (mesh.faces, np.int64, rows)):
        assert array.dtype == kind
        assert array.flags.c_contiguous
        assert array.tolist() == expected


def test_vertices_may_be_unused_or_repeated_in_a_face():
    assert Mesh([*CORNERS, [9.0, 9.0, 9.0]], [[0, 1, 1]]).vertices.shape == (4, 3)


@pytest.mark.parametrize("name", ["vertices", "faces"])
def test_is_frozen(name):
    mesh = Mesh(CORNERS, [[0, 1, 2]])
    with pytest.raises(ValueError, match="read-only"):
        getattr(mesh, name)[0, 0] = 1
    with pytest.raises(AttributeError):
        setattr(mesh, name, None)


@pytest.mark.parametrize(
    ("vertices", "faces", "error"),
    [
        pytest.param(CORNERS, [[0, 1, 3]], MalformedMeshError, id="index one too large"),
        pytest.param(CORNERS, [[0, 1, 2**62]], MalformedMeshError, id="index far too large"),
        pytest.param(CORNERS, [[0, 1, -1]], MalformedMeshError, id="negative index"),
        pytest.param(CORNERS, [[0, 1, 1.5]], MalformedMeshError, id="fractional index"),
        pytest.param(CORNERS, [[0, 1, -0.5]], MalformedMeshError, id="fraction that would be cut to 0"),
        pytest.param(CORNERS, [[0, 1, np.nan]], MalformedMeshError, id="index not a number"),
        pytest.param(CORNERS, [[0, 1, np.inf]], MalformedMeshError, id="index infinite"),
        pytest.param(CORNERS, [[0, 1, 1e300]], MalformedMeshError, id="index past all integers"),
        pytest.param(CORNERS, [[0, 1]], MalformedMeshError, id="two corners"),
        pytest.param(CORNERS, [[0, 1, 2, 0]], MalformedMeshError, id="four corners"),
        pytest.param(CORNERS, [0, 1, 2], MalformedMeshError, id="faces not a table"),
        pytest.param([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], MalformedMeshError, id="plane coordinates"),
        pytest.param([0, 0, 0], [[0, 0, 0]], MalformedMeshError, id="vertices not a table"),
        pytest.param(np.zeros((0, 3)), [[0, 0, 0]], MalformedMeshError, id="no vertices"),
        pytest.param(CORNERS, np.zeros((0, 3), dtype=int), NoTrianglesError, id="no faces"),
        pytest.param(np.zeros((0, 3)), np.zeros((0, 3), dtype=int), NoTrianglesError, id="nothing"),
    ],
)
def test_refuses(vertices, faces, error):
    with pytest.raises(error):
        Mesh(vertices, faces)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 3])
def test_refuses_what_is_not_finite_even_where_no_face_is(value, row):
    vertices = np.array([*CORNERS, [5.0, 5.0, 5.0]])
    vertices[row, 2] = value
    with pytest.raises(NonFiniteCoordinatesError):
        Mesh(vertices, [[0, 1, 2]])


def test_the_message_names_the_wrong_index():
    with pytest.raises(MeshError, match="not whole"):
        Mesh(CORNERS, [[0, 1, 1.5]])
    with pytest.raises(MeshError, match="vertex 7, but there are 3"):
        Mesh(CORNERS, [[0, 1, 7]])
    with pytest.raises(MeshError, match="vertex -2, but there are 3"):
        Mesh(CORNERS, [[0, 1, -2]])


def test_the_other_direction_of_a_face_has_the_opposite_normal():
    corners = np.array([[(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 3.0, 0.0)]])
    for unit, length in ((True, 1.0), (False, 6.0)):
        assert face_normals(corners, unit=unit).tolist() == [[0.0, 0.0, length]]
        assert face_normals(corners[:, ::-1], unit=unit).tolist() == [[0.0, 0.0, -length]]


def test_a_triangle_without_area_has_the_normal_zero():
    line = np.array([[(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2.0, 2.0, 2.0)]])
    assert face_normals(line).tolist() == [[0.0, 0.0, 0.0]]
