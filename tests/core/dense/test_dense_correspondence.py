"""Correspondences of all vertices between solids whose differences are known; maps of known stretch."""

import numpy as np
import pytest

from core import Mesh, Pipeline
from core.dense.dense_correspondence import stretch
from core.dense.functional_maps import FUNCTIONS
from core.dense.working_surface import MOST_VERTICES
from core.evaluation.correspondence_errors import surface_distances
from core.registration.similarity import best_similarity
from tests.core.dense.solids import SIDE, chair, plate
from tests.core.shapes import rectangle, scaled, shifted, subdivided, turned
from tests.gallery import make_body
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, part

HOLES = [(4, 4), (22, 12)]
MORE = (14, 8)


PIPELINE = Pipeline()


def both_ways(first, second, transform=None):
    """The correspondences by as few functions as the page asks for, in a third of the time."""
    return PIPELINE.surface_map(first, second, None, transform, functions=FUNCTIONS).correspondences()


@pytest.fixture(scope="module")
def chairs():
    """A chair without a leg, a turned chair with four, and their correspondence both ways."""
    without, whole = chair(3), turned(chair(4), 3)
    return without, whole, both_ways(without, whole)


def in_last_leg(points):
    """Vertices of the leg that the chair of three legs lacks, below the seat."""
    return (points[:, 0] > 0.95) & (points[:, 1] > 0.85) & (points[:, 2] < 0.95)


def test_a_part_that_is_missing_has_no_partner(chairs):
    _, whole, (_, back) = chairs
    missing = in_last_leg(chair(4).vertices)
    assert (~back.partnered[missing]).mean() > 0.9
    assert back.partnered[~missing].all()
    assert (back.confidence[~back.partnered] == 0.0).all()
    assert back.displacement[missing].max() > 0.8
    assert len(back.vertices) == len(whole.vertices)


def test_parts_that_are_there_correspond_exactly_and_stay(chairs):
    without, _, (found, _) = chairs
    expected = chair(4).vertices
    gaps = np.linalg.norm(expected[found.vertices] - without.vertices, axis=1)
    assert np.mean(gaps < 1e-6) > 0.98
    assert np.quantile(found.displacement, 0.95) < 0.02
    assert found.confidence.min() >= 0.0
    assert found.confidence.max() <= 1.0
    assert np.median(found.confidence) > 0.9
    assert found.scale == pytest.approx(1.0, abs=0.01)
    assert not found.simplified


def test_a_hole_that_one_plate_has_more():
    fewer, more = plate(HOLES), turned(plate([*HOLES, MORE]), 5)
    found, back = both_ways(fewer, more)
    low = SIDE * np.array([*MORE, 0])
    hole = fewer.vertices[:, :2] - low[:2]
    inside = ((hole > 0.01) & (hole < 3 * SIDE - 0.01)).all(axis=1)
    assert inside.any()
    assert found.displacement[inside].min() > 0.05
    assert found.displacement[~inside].max() < 0.03
    wall = plate([*HOLES, MORE]).vertices[:, :2] - low[:2]
    near = ((wall > -0.01) & (wall < 3 * SIDE + 0.01)).all(axis=1)
    assert back.displacement[near].max() > 0.05
    assert back.displacement[~near].max() < 0.03


def test_a_bent_leg_has_moved_and_has_its_partner():
    straight = chair()
    leg = in_last_leg(straight.vertices)
    points = straight.vertices.copy()
    points[leg, 0] += 0.6 * (1.0 - points[leg, 2])
    found, _ = both_ways(straight, turned(Mesh(points, straight.faces), 4))
    moved = 0.6 * (1.0 - straight.vertices[leg, 2])
    assert found.displacement[leg].max() == pytest.approx(moved.max(), rel=0.2)
    assert found.displacement[~leg].max() < 0.03
    assert found.partnered[leg].mean() > 0.8


def test_files_without_a_common_scale():
    factor = 25.4e-3
    one = chair()
    found, _ = both_ways(one, scaled(turned(one, 7), factor))
    assert found.scale == pytest.approx(factor, rel=1e-3)
    assert (found.displacement < 1e-3).all()
    np.testing.assert_allclose(found.stretch, 1.0, atol=0.01)
    np.testing.assert_array_equal(found.vertices, np.arange(len(one.vertices)))


def test_a_registered_copy_lies_on_the_other_and_has_a_partner_everywhere():
    first, second = (part("shaft", Drawing(4, tolerance, 0.37)) for tolerance in (0.05, 0.1))
    placed = moved(second, 4, scale=25.4)
    transform = best_similarity(second.vertices, placed.vertices, sign=1, scaled=True)
    for found, scale in zip(both_ways(first, placed, transform), (1.0, 25.4), strict=True):
        assert found.partnered.all()
        # The chord tolerances of both.
        assert found.displacement.max() <= 0.15 * scale
        assert max(found.scale, 1.0 / found.scale) == pytest.approx(25.4)


def test_poses_are_no_rigid_copies_and_correspond():
    body = make_body("teddy", 1, vertices=900)
    found = PIPELINE.correspond(body.posed(1), body.posed(2))
    distances = surface_distances(body)
    everywhere = np.arange(len(body.rest.vertices))
    errors = distances[found.vertices, body.partners(body)].mean(axis=1)
    assert errors.min() < 0.05
    assert found.displacement is None
    assert found.partnered.mean() > 0.95
    closest = body.partners(body)[errors.argmin()]
    far = distances[found.vertices, closest[everywhere]]
    sure = found.confidence >= np.median(found.confidence)
    assert far[sure].mean() < far[~sure].mean()


def test_above_the_bound_the_meshes_are_simplified_and_all_vertices_get_a_partner():
    fine = subdivided(subdivided(chair()))
    coarse = shifted(chair(), [5.0, 1.0, 0.0])
    assert len(fine.vertices) > MOST_VERTICES
    found, back = both_ways(fine, coarse)
    assert found.simplified
    assert back.simplified
    assert found.vertices.shape == (len(fine.vertices),)
    gaps = np.linalg.norm(chair().vertices[found.vertices] - fine.vertices, axis=1)
    assert gaps.max() < 2 * SIDE
    assert found.displacement.max() < 0.03
    ends = np.linalg.norm(fine.vertices[back.vertices] - chair().vertices, axis=1)
    assert ends.max() < SIDE


def test_an_open_and_a_closed_surface():
    closed = chair()
    centres = closed.vertices[closed.faces].mean(axis=1)
    open_one = Mesh(closed.vertices, closed.faces[centres[:, 2] > 0.01])
    found, _ = both_ways(open_one, closed)
    used = np.unique(open_one.faces)
    gaps = np.linalg.norm(closed.vertices[found.vertices[used]] - open_one.vertices[used], axis=1)
    assert np.median(gaps) < SIDE


def test_unused_vertices_are_never_a_partner():
    one = chair()
    stray = Mesh(np.concatenate([[[9.0, 9.0, 9.0]], one.vertices, one.vertices]), one.faces + 1)
    found, back = both_ways(one, stray)
    assert set(found.vertices) <= set(range(1, len(one.vertices) + 1))
    assert back.vertices.shape == (len(stray.vertices),)


def test_a_mesh_of_two_faces():
    found, back = both_ways(rectangle(1.0, 1.5, 1, 1), chair())
    assert found.vertices.shape == (4,)
    assert 0 <= found.vertices.min() <= found.vertices.max() < len(chair().vertices)
    assert set(back.vertices) <= {0, 1, 2, 3}
    for side in (found, back):
        assert np.isfinite(side.stretch).all()
        assert np.isfinite(side.confidence).all()


def test_a_sheet_of_which_one_half_is_drawn_out():
    sheet = rectangle(2.0, 1.0, 40, 20)
    points = sheet.vertices.copy()
    points[:, 0] += np.maximum(points[:, 0] - 1.0, 0.0)
    found = stretch(sheet, turned(Mesh(points, sheet.faces), 2), np.arange(len(points)))
    left, right = sheet.vertices[:, 0] < 0.7, sheet.vertices[:, 0] > 1.3
    assert np.ptp(np.log(found[left])) < 0.01
    # Twice as long in one of two directions.
    assert np.median(found[right]) / np.median(found[left]) == pytest.approx(np.sqrt(2.5), rel=0.1)


def test_size_is_no_stretch():
    sheet = rectangle(2.0, 1.0, 12, 6)
    np.testing.assert_allclose(stretch(sheet, scaled(sheet, 9.0), np.arange(len(sheet.vertices))), 1.0)


def test_a_neighbourhood_that_shrinks_to_a_point():
    sheet = rectangle(1.0, 1.0, 8, 8)
    there = np.arange(len(sheet.vertices))
    there[: len(there) // 3] = 0
    found = stretch(sheet, sheet, there)
    assert np.isfinite(found).all()
    assert found.min() < 0.1
