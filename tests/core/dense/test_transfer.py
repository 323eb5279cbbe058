"""Points, curves and distances carried over: copies whose motion is known, and bodies with a template."""

import numpy as np
import pytest

from core import Pipeline
from core.dense.functional_maps import FUNCTIONS
from core.dense.transfer import (
    OffSurfaceError,
    _closest_shares,
    curve_length,
    distances_between,
    transferred_curves,
    transferred_points,
)
from core.dense.working_surface import working_surface
from core.gallery.bodies import individual_partners
from core.mesh.box_tree import closest_on_triangles
from core.mesh.cleaning import face_areas
from core.mesh.normal_frame import normal_frame
from tests.core.dense.solids import chair, solid
from tests.core.shapes import rectangle, scaled, turned
from tests.gallery import make_body

PIPELINE = Pipeline()
BRICK = solid(np.ones((9, 6, 3)))
HALF_TURN = np.array([-1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def copy():
    """A chair, and the same turned and 25.4 times as large."""
    one = chair()
    other = scaled(turned(one, 3), 25.4)
    return one, other, PIPELINE.surface_map(one, other)


def test_points_of_a_copy_move_with_it(copy):
    one, other, found = copy
    shares = np.random.default_rng(0).dirichlet(np.ones(3), 40)
    ours, theirs = (np.einsum("fc,fcx->fx", shares, mesh.vertices[mesh.faces[:40]]) for mesh in (one, other))
    moved = transferred_points(found, ours)
    np.testing.assert_allclose(moved.points, theirs, atol=1e-6 * np.ptp(other.vertices))
    assert moved.confidence.min() > 0.99


def test_a_curve_of_a_copy_keeps_its_length(copy):
    _, _, found = copy
    # Across the seat, whose top is at the height 1.2.
    curve = np.array([[0.3, 0.15, 1.2], [1.0, 0.15, 1.2], [1.0, 0.75, 1.2]])
    ((ours, theirs),) = transferred_curves(found, [curve])
    assert ours.shape == theirs.shape
    assert len(ours) > 20
    assert curve_length(ours) == pytest.approx(1.3)
    assert curve_length(theirs) == pytest.approx(25.4 * 1.3, rel=1e-4)
    np.testing.assert_allclose(ours[:, 2], 1.2, atol=1e-9)


def test_landmarks_tell_the_half_turn_of_a_brick():
    points = BRICK.vertices[::13]
    centre = BRICK.vertices.mean(axis=0)
    half_turned = centre + HALF_TURN * (points - centre)
    embedding = PIPELINE.embed(BRICK)
    landmarks = points[:5], half_turned[:5]
    found = PIPELINE.surface_map(BRICK, BRICK, (embedding, embedding), landmarks=landmarks)
    # Registration is exact to some thousandths of a side.
    np.testing.assert_allclose(transferred_points(found, points).points, half_turned, atol=1e-3)


@pytest.mark.parametrize(("label", "count"), [("person", 0), ("octopus", 6)])
def test_twenty_points_of_another_body(label, count):
    """The arms of an octopus are alike: several maps fit, and landmarks tell which."""
    bodies = [make_body(label, number, vertices=900) for number in (0, 1)]
    first, second = (body.posed(number) for number, body in enumerate(bodies))
    drawn = np.random.default_rng(0).permutation(len(first.vertices))[: 20 + count]
    ours, theirs = first.vertices[drawn], second.vertices[individual_partners(*bodies)[0][drawn]]
    pair = first, second, (PIPELINE.embed(first), PIPELINE.embed(second))
    found = PIPELINE.surface_map(*pair, functions=FUNCTIONS)
    if count:
        assert found.maps > 1
        found = PIPELINE.surface_map(*pair, functions=FUNCTIONS, landmarks=(ours[20:], theirs[20:]))
        assert found.maps == 1
    gaps = np.linalg.norm(transferred_points(found, ours[:20]).points - theirs[:20], axis=1)
    assert gaps.mean() < 0.03 * np.sqrt(face_areas(second.vertices, second.faces).sum())


def test_a_landmark_off_the_surface_is_told():
    points = BRICK.vertices[:3]
    away = points + np.array([[0.0, 0.0, 0.0], [-0.05, -0.05, -0.05], [-9.0, 0.0, 0.0]])
    with pytest.raises(OffSurfaceError, match="landmark 2 of the second shape is 9"):
        PIPELINE.surface_map(BRICK, BRICK, landmarks=(points, away))


def test_distances_on_a_bent_sheet():
    """Two sides of a roof: the ridge is at x = 1, and a path across it is longer than the straight one."""
    sheet = rectangle(2.0, 1.0, 40, 20)
    points = sheet.vertices.copy()
    points[:, 2] = np.abs(points[:, 0] - 1.0)
    roof = type(sheet)(points, sheet.faces)
    surface = working_surface(roof, *_framed(roof), points[:1])
    at = np.array([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [0.51, 0.51, 0.49]])
    straight, along = distances_between(surface, at)
    assert straight[0, 1] == pytest.approx(1.0)
    assert along[0, 1] == pytest.approx(np.sqrt(2.0), rel=0.03)
    assert along[0, 2] >= straight[0, 2] > 0.0
    np.testing.assert_allclose(np.diag(along), 0.0, atol=1e-12)
    np.testing.assert_allclose(along, along.T)


def _framed(mesh):
    frame = normal_frame(mesh)
    return type(mesh)(frame.apply(mesh.vertices), mesh.faces), frame


def test_the_nearest_point_of_a_triangle_is_that_of_the_kernel():
    corners = np.random.default_rng(1).normal(size=(300, 3, 3))
    shares, squares = _closest_shares(corners)
    expected = closest_on_triangles(corners, np.arange(300)[:, None], np.zeros((300, 3)))
    found = np.einsum("qc,qcx->qx", shares, corners)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(squares, (expected**2).sum(axis=1), atol=1e-12)
    assert shares.min() >= 0.0
