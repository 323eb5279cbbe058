"""The bounding boxes: the least one belongs to the shape in any turn, the other to the file."""

import numpy as np
import pytest
import trimesh

from core.mesh.bounding_box import EQUAL_VOLUME, MOST_CORNERS, bounding_box, file_box
from core.mesh.mesh import Mesh
from tests.core.shapes import (
    SAME_SHAPE,
    blob,
    box,
    icosphere,
    joined,
    prism,
    rectangle,
    scaled,
    shifted,
    star,
    subdivided,
    turned,
)


def bracket(length, height, depth, thickness):
    """Two plates at a right angle."""
    legs = box(length, thickness, depth), box(thickness, height, depth)
    return joined(*(shifted(leg, -leg.vertices.min(axis=0)) for leg in legs))


def wedge(length, height, depth):
    """A prism on a right triangle, whose three sides carry boxes of one volume."""
    corners = [[x, y, z] for z in (0, depth) for x, y in ((0, 0), (length, 0), (0, height))]
    sides = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
    return Mesh(corners, sides)


TETRAHEDRON = Mesh(
    [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
)
KNOWN = {
    "bracket": (bracket(60, 50, 40, 5), (60, 50, 40)),
    "wedge": (wedge(4, 3, 7), (7, 4, 3)),
    "tetrahedron in a cube": (TETRAHEDRON, (2, 2, 2)),
    "triangular prism": (prism(3, 5.0), (5, 3**0.5, 1.5)),
    "hexagonal prism": (prism(6, 5.0), (5, 2, 3**0.5)),
    "cube": (box(20, 20, 20), (20, 20, 20)),
    "square tube": (box(20, 100, 20), (100, 20, 20)),
    "nearly square tube": (box(19.9, 20, 100), (100, 20, 19.9)),
    "square plate": (box(2, 50, 50), (50, 50, 2)),
    "block": (box(10, 20, 30), (30, 20, 10)),
    "square sheet": (rectangle(3.0, 3.0, 5, 7), (3, 3, 0)),
    "sheet": (rectangle(3.0, 4.0, 5, 7), (4, 3, 0)),
    "lone vertex": (Mesh([*box(3, 2, 1).vertices, [100, 0, 0]], box(3, 2, 1).faces), (3, 2, 1)),
    "sliver": (Mesh([[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]], [[0, 1, 2]]), (1, 0, 0)),
    "points on a line": (Mesh([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], [[0, 1, 2]]), (1, 0, 0)),
}


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("seed", range(4))
def test_a_shape_of_known_sides_has_them_in_any_turn(name, seed):
    mesh, sides = KNOWN[name]
    mesh = shifted(turned(mesh, seed), (4, -5, 6))
    wanted = tuple(round(side, 6 - int(np.log10(max(sides)))) for side in sides)
    assert bounding_box(mesh) == wanted
    assert bounding_box(subdivided(mesh)) == wanted


@pytest.mark.parametrize("factor", [1e-20, 1e-3, 25.4, 1e20])
def test_sizes_of_any_magnitude_are_measured(factor):
    mesh = scaled(turned(bracket(60, 50, 40, 5), 5), factor)
    assert bounding_box(mesh) == pytest.approx((60 * factor, 50 * factor, 40 * factor), rel=1e-6)


@pytest.mark.parametrize("change", SAME_SHAPE)
def test_the_box_belongs_to_the_shape(change):
    mesh = blob(2)
    factor = 37.3 if change == "scaled" else 0.021 if change == "all of these" else 1.0
    wanted = bounding_box(scaled(mesh, factor))
    assert bounding_box(SAME_SHAPE[change](mesh)) == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("mesh", [blob(1), blob(5), star(5), icosphere(3)])
def test_no_box_on_a_facet_of_the_hull_has_less_volume(mesh):
    on_facet = trimesh.bounds.oriented_bounds(mesh.vertices)[1]
    assert np.prod(bounding_box(mesh)) <= (1.0 + 1.01 * EQUAL_VOLUME) * np.prod(on_facet)


def test_the_least_box_of_an_ellipsoid_is_along_its_axes():
    """By Hadamard's inequality: the squared sides are the diagonal of a matrix of constant determinant."""
    ball = icosphere(5)
    assert len(ball.vertices) > MOST_CORNERS
    mesh = turned(Mesh(ball.vertices * [3.0, 2.0, 1.0], ball.faces), 1)
    assert bounding_box(mesh) == pytest.approx((6.0, 4.0, 2.0), rel=5e-3)


def test_the_box_of_the_file_is_along_its_axes():
    assert file_box(shifted(box(10, 30, 20), (4, -5, 6))) == (10, 30, 20)
    mesh = turned(blob(), 7)
    assert file_box(mesh) == pytest.approx(np.ptp(mesh.vertices, axis=0), rel=1e-6)
    assert file_box(KNOWN["lone vertex"][0]) == (3, 2, 1)
