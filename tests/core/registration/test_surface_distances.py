"""Distances of surfaces after registration, against closed forms, and on large triangles."""

import numpy as np
import pytest
from manifold3d import Manifold

from core.mesh.mesh import Mesh
from core.registration.probed_surface import probed_surface
from core.registration.rigid_copy import copy_by_surfaces
from core.registration.similarity import Similarity, similarity_of, to_unit_area
from core.registration.surface_distances import SurfaceDistances, surface_distances
from tests.core.registration.test_rigid_copy import even
from tests.studies.copies import moved

SIZE = (60.0, 40.0, 10.0)
WIDE = 6.0
SAME = Similarity(1.0, np.eye(3), np.zeros(3))


def mesh_of(body: Manifold) -> Mesh:
    made = body.to_mesh64()
    return Mesh(np.array(made.vert_properties[:, :3], dtype=float), made.tri_verts.astype(np.int64))


def box() -> Manifold:
    return Manifold.cube(SIZE, center=True)


def cube(size: tuple[float, float, float], at: tuple[float, float, float]) -> Manifold:
    return Manifold.cube(size, center=True).translate(at)


def distances(
    first: Mesh, second: Mesh, transform: Similarity = SAME
) -> tuple[SurfaceDistances, SurfaceDistances]:
    return surface_distances((first, second), (probed_surface(first), probed_surface(second)), transform)


def farthest(one: SurfaceDistances) -> np.ndarray:
    return one.mesh.vertices[np.argmax(one.distances)]


BOX = mesh_of(box())
HOLE = mesh_of(box() - cube((WIDE, WIDE, 20.0), (5.0, -3.0, 0.0)))


def test_a_hole_in_the_middle_of_two_triangles_is_found() -> None:
    assert len(BOX.faces) == 12
    whole, drilled = distances(BOX, HOLE)
    # The middle of the opening is half a width from the rim; half of the thickness is deeper in the hole.
    assert whole.largest == pytest.approx(0.5 * WIDE, rel=0.02)
    np.testing.assert_allclose(farthest(whole)[:2], [5.0, -3.0], atol=0.1)
    assert abs(farthest(whole)[2]) == pytest.approx(5.0)
    assert drilled.largest == pytest.approx(5.0, rel=0.02)
    # The distance of each vertex of the face from the rim, of which a little is within sampling.
    expected = np.maximum(0.5 * WIDE - np.abs(whole.mesh.vertices[:, :2] - [5.0, -3.0]).max(axis=1), 0.0)
    np.testing.assert_allclose(whole.distances, expected, atol=1e-9)
    assert (expected > 0.0).sum() > 100
    assert whole.deviating[expected > 0.02].all()
    assert not whole.deviating[expected == 0.0].any()


@pytest.mark.parametrize("wide", [0.3, 0.6, 1.2])
def test_a_hole_that_is_smaller_than_the_refined_triangles_is_found(wide: float) -> None:
    hole = mesh_of(box() - cube((wide, wide, 20.0), (5.1, -3.3, 0.0)))
    whole, drilled = distances(BOX, hole)
    assert whole.largest == pytest.approx(0.5 * wide, rel=0.05)
    assert drilled.largest == pytest.approx(5.0, rel=0.02)


def test_what_is_lacking_and_what_is_added_both_show() -> None:
    pin = cube((4.0, 4.0, 6.0), (-10.0, 5.0, 8.0))
    pocket = cube((8.0, 8.0, 4.0), (15.0, 0.0, 5.0))
    plain, other = mesh_of(box() + pin), mesh_of(box() - pocket)
    first, second = distances(plain, other)
    # The pin's tip is 6 above the face, and the pocket's floor 2 below it.
    assert first.largest == pytest.approx(6.0)
    assert farthest(first)[2] == pytest.approx(11.0)
    assert second.largest == pytest.approx(2.0)
    np.testing.assert_allclose(farthest(second), [15.0, 0.0, 5.0], atol=4.1)


@pytest.mark.parametrize("reflected", [False, True])
def test_distances_are_in_units_of_each_file(reflected: bool) -> None:
    placed = moved(HOLE, 3, scale=25.4, mirrored=reflected)
    transform = best(HOLE, placed)
    whole, drilled = distances(BOX, placed, transform)
    assert whole.largest == pytest.approx(0.5 * WIDE, rel=0.02)
    assert drilled.largest == pytest.approx(25.4 * 5.0, rel=0.02)
    np.testing.assert_allclose(np.sort(np.ptp(whole.mesh.vertices, axis=0)), np.sort(SIZE))


def best(first: Mesh, second: Mesh) -> Similarity:
    """The transform between two meshes with the same vertices."""
    rows = np.column_stack([first.vertices, np.ones(len(first.vertices))])
    solved = np.linalg.lstsq(rows, second.vertices, rcond=None)[0].T
    return similarity_of(np.vstack([solved, [0.0, 0.0, 0.0, 1.0]]))


def test_a_copy_on_other_triangles_has_no_difference() -> None:
    spheres = [Manifold.sphere(10.0, count) for count in (96, 48)]
    middles = [mesh.vertices[mesh.faces].mean(axis=1) for mesh in map(mesh_of, spheres)]
    # Vertices lie on the sphere, and the middles of triangles below it.
    errors = sum(10.0 - float(np.linalg.norm(points, axis=1).min()) for points in middles)
    fine, coarse = (mesh_of(sphere + box()) for sphere in spheres)
    for one in distances(fine, coarse):
        assert one.largest == 0.0
        assert not one.deviating.any()
        assert one.distances.max() <= errors


@pytest.mark.parametrize("spikes", [2, 20])
def test_what_the_judge_overlooks_is_not_drawn(spikes: int) -> None:
    """A copy with a few flaws is a copy; where there are many, each shows."""
    ball = even("sphere", 4)
    vertices = ball.vertices.copy()
    vertices[:: len(vertices) // spikes] *= 1.04
    second = Mesh(vertices, ball.faces)
    found = copy_by_surfaces(probed_surface(ball), probed_surface(second), (ball.vertices, vertices))
    assert found is not None
    assert (found.difference is None) == (spikes == 2)
    drawn = max(one.largest for one in distances(ball, second, found.placing.inverse))
    assert drawn == (0.0 if found.difference is None else pytest.approx(2.0, rel=0.05))


def test_the_transform_to_unit_area_goes_before_and_after_another() -> None:
    placed = moved(HOLE, 5, scale=3.0)
    units = [to_unit_area(probed_surface(mesh).samples) for mesh in (HOLE, placed)]
    motion = units[0].inverse.then(best(HOLE, placed)).then(units[1])
    assert motion.scale == pytest.approx(1.0)
    np.testing.assert_allclose(motion.apply(units[0].apply(HOLE.vertices)), units[1].apply(placed.vertices))
