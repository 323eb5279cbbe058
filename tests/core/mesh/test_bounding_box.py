"""The bounding box: bodies whose extents are known, however they are turned, moved and tessellated."""

import numpy as np
import pytest

from core.mesh.mesh import Mesh
from core.mesh.normal_frame import bounding_box
from tests.core.shapes import SAME_SHAPE, blob, box, icosphere, rectangle, scaled, shifted, subdivided, turned

SQUARES = {
    "cube": (20.0, 20.0, 20.0),
    "square tube": (100.0, 20.0, 20.0),
    "nearly square tube": (100.0, 20.0, 19.9),
    "square plate": (50.0, 50.0, 2.0),
    "block": (30.0, 20.0, 10.0),
}


@pytest.mark.parametrize("extents", SQUARES.values(), ids=SQUARES)
@pytest.mark.parametrize("seed", range(4))
def test_a_turned_block_has_its_own_extents(extents, seed):
    mesh = shifted(turned(box(*extents[::-1]), seed), (4, -5, 6))
    assert bounding_box(mesh) == pytest.approx(extents, rel=1e-6)
    assert bounding_box(subdivided(mesh)) == pytest.approx(extents, rel=1e-6)


def test_a_sheet_has_no_height():
    assert bounding_box(turned(rectangle(3.0, 3.0, 5, 7), 1)) == pytest.approx((3.0, 3.0, 0.0), abs=1e-9)


def test_a_ball_is_as_wide_as_its_diameter():
    assert bounding_box(turned(icosphere(4, 2.5), 3)) == pytest.approx((5.0, 5.0, 5.0), rel=0.01)


def test_a_body_without_ties_is_measured_along_its_eigenvectors():
    mesh = blob()
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    middles = (corners + np.roll(corners, 1, axis=1)) / 2.0
    weights = np.repeat(areas / areas.sum() / 3.0, 3)
    points = middles.reshape(-1, 3)
    axes = np.linalg.eigh(np.cov(points.T, aweights=weights, ddof=0))[1]
    wanted = sorted(np.ptp(mesh.vertices @ axes, axis=0), reverse=True)
    assert bounding_box(mesh) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("change", SAME_SHAPE)
def test_the_box_belongs_to_the_shape(change):
    mesh = blob(2)
    factor = 37.3 if change == "scaled" else 0.021 if change == "all of these" else 1.0
    wanted = bounding_box(scaled(mesh, factor))
    assert bounding_box(SAME_SHAPE[change](mesh)) == pytest.approx(wanted, rel=1e-6)


def test_vertices_without_faces_do_not_count():
    mesh = box(3.0, 2.0, 1.0)
    lone = Mesh(np.vstack([mesh.vertices, [[100.0, 0.0, 0.0]]]), mesh.faces)
    assert bounding_box(lone) == pytest.approx((3.0, 2.0, 1.0))


@pytest.mark.parametrize("factor", [1e-20, 1e20])
def test_sizes_of_any_magnitude_are_measured(factor):
    assert bounding_box(turned(box(3 * factor, 2 * factor, factor), 5)) == pytest.approx(
        (3 * factor, 2 * factor, factor), rel=1e-6
    )


def test_a_sliver_on_a_line_has_a_box():
    sliver = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]], [[0, 1, 2]])
    assert bounding_box(sliver) == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
