"""Correspondences extended to all vertices, where the truth is known: a surface and a moved copy of it."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from core.dense.functional_maps import (
    FUNCTIONS,
    RIDGES,
    basis,
    compared_rows,
    functional_map,
    nearest_both_ways,
)
from core.errors import ParameterError
from core.evaluation.correspondence_errors import PreparedMesh, dense_map, surface_distances
from core.gallery.bodies import individual_partners
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from tests.gallery import make_body


@pytest.fixture(scope="module")
def body():
    return make_body("teddy", 1, vertices=900)


@pytest.fixture(scope="module")
def shuffled(body):
    """The body at rest, and a pose of it whose vertex `order[i]` is the body's vertex i."""
    order = np.random.default_rng(3).permutation(len(body.rest.vertices))
    posed = body.posed(2)
    moved = np.empty_like(posed.vertices)
    moved[order] = posed.vertices
    return order, basis(body.rest, FUNCTIONS), basis(Mesh(moved, order[posed.faces]), FUNCTIONS)


def pairs_of(order, count, wrong=0):
    rng = np.random.default_rng(5)
    here = rng.permutation(len(order))[:count]
    there = order[here]
    there[:wrong] = rng.permutation(there[:wrong])
    return np.stack([here, there], axis=1)


def test_functions_are_orthonormal_by_area(body):
    found = basis(body.rest, 40)
    assert found.areas.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(
        found.functions.T @ (found.areas[:, None] * found.functions), np.eye(40), atol=1e-6
    )
    np.testing.assert_allclose(found.functions[:, 0], 1.0)


def test_a_surface_and_itself(body, shuffled):
    _, here, _ = shuffled
    everywhere = np.arange(len(body.rest.vertices))
    pairs = np.stack([everywhere[::9], everywhere[::9]], axis=1)
    np.testing.assert_array_equal(functional_map(here, here, pairs).partners(here, here), everywhere)


@pytest.mark.parametrize("wrong", [0, 25])
def test_a_pose_with_its_vertices_in_another_order(body, shuffled, wrong):
    order, here, there = shuffled
    inverse = np.argsort(order)
    distances = surface_distances(body)
    everywhere = np.arange(len(order))
    for first, second, pairs, back in (
        (here, there, pairs_of(order, 100, wrong), inverse),
        (there, here, pairs_of(order, 100, wrong)[:, ::-1], order),
    ):
        found = functional_map(first, second, pairs).partners(first, second)
        # In the body's own numbers: the partner of each vertex should be that vertex.
        errors = distances[back[found], everywhere] if second is there else distances[found, inverse]
        assert errors.mean() < 0.02
        assert (errors < 0.1).mean() > 0.98


def test_pairs_that_are_all_wrong(body, shuffled):
    """The signs of the first functions give the right map."""
    order, here, there = shuffled
    random = np.random.default_rng(0)
    pairs = np.stack([random.permutation(len(order))[:100] for _ in range(2)], axis=1)
    found = np.argsort(order)[functional_map(here, there, pairs).partners(here, there)]
    assert surface_distances(body)[found, np.arange(len(order))].mean() < 0.02


def test_functions_that_do_not_correspond_count_less(body):
    other = make_body("teddy", 2, vertices=900)
    first, second = (basis(each.rest, FUNCTIONS + 50) for each in (body, other))
    everywhere = np.arange(len(body.rest.vertices))
    as_it_is = functional_map(first, first, np.stack([everywhere, everywhere], axis=1))
    for side in as_it_is.domain:
        np.testing.assert_allclose(np.linalg.norm(side, axis=0), 1.0, atol=1e-3)
    truth = individual_partners(body, other)[0]
    found = functional_map(first, second, np.stack([everywhere, truth], axis=1))
    ours, theirs = (np.linalg.norm(side, axis=0) for side in found.domain)
    np.testing.assert_allclose(ours, theirs)
    assert 1.0 >= ours[:10].min() > 0.95 > 0.8 > ours[-10:].max()


def test_a_rod_may_be_turned_about_its_length():
    outline = [(0.0, 0.0), *((1.0 - 0.04 * z, z) for z in range(13)), (0.0, 12.0)]
    solid = trimesh.creation.revolve(outline, sections=16)
    rod = basis(Mesh(solid.vertices, solid.faces), FUNCTIONS)
    turned = cKDTree(solid.vertices).query(solid.vertices * (-1.0, -1.0, 1.0))[1]
    everywhere = np.arange(len(turned))
    as_it_is, about = (np.stack([everywhere, ends], axis=1) for ends in (everywhere, turned))
    assert functional_map(rod, rod, [as_it_is, about]).fitting == 2
    assert functional_map(rod, rod, [as_it_is, as_it_is]).fitting == 1


def test_a_mesh_of_fewer_vertices_than_functions():
    solid = trimesh.creation.box((1.0, 2.0, 3.0)).subdivide()
    mesh = Mesh(solid.vertices, solid.faces)
    found = basis(mesh, FUNCTIONS)
    assert found.functions.shape == (len(mesh.vertices), len(mesh.vertices))
    everywhere = np.arange(len(mesh.vertices))
    onto_itself = functional_map(found, found, np.stack([everywhere] * 2, axis=1))
    np.testing.assert_array_equal(onto_itself.partners(found, found), everywhere)


@pytest.mark.parametrize("pairs", [np.empty((0, 2), dtype=np.int64), np.zeros(4, dtype=np.int64)])
def test_pairs_that_say_nothing(shuffled, pairs):
    with pytest.raises(ParameterError):
        functional_map(shuffled[1], shuffled[2], pairs)


def test_mean_curvature_of_a_sphere():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=7.0)
    found = basis(Mesh(ball.vertices, ball.faces[:, ::-1]), FUNCTIONS)
    # At unit area -2 over the radius, whichever way the faces are turned; the mesh is a polyhedron.
    np.testing.assert_allclose(found.curvature, -2.0 * np.sqrt(4.0 * np.pi), rtol=0.02)

    # A surface that is round everywhere has no ridges, whatever its triangles.
    assert (
        np.abs(compared_rows(found, found, (np.eye(FUNCTIONS),) * 2)[0][:, FUNCTIONS:]).max() < 0.15 * RIDGES
    )


def test_ridges_have_one_weight(shuffled):
    _, here, _ = shuffled
    rows, same = compared_rows(here, here, (np.eye(FUNCTIONS),) * 2)
    np.testing.assert_allclose(rows, same)
    np.testing.assert_array_equal(same[:, :FUNCTIONS], here.functions)
    np.testing.assert_allclose(here.areas @ rows[:, FUNCTIONS:], 0.0, atol=1e-9)
    np.testing.assert_allclose(here.areas @ rows[:, FUNCTIONS:] ** 2, RIDGES**2)


def test_mean_curvature_of_a_torus():
    whole, tube = 1.0, 0.4
    ring = trimesh.creation.torus(whole, tube, major_sections=64, minor_sections=32)
    found = basis(Mesh(ring.vertices, ring.faces), FUNCTIONS)
    along = np.hypot(*ring.vertices[:, :2].T)
    expected = -(1.0 / tube + (along - whole) / (tube * along)) * np.sqrt(4.0 * np.pi**2 * whole * tube)
    np.testing.assert_allclose(found.curvature[:, 0], expected, atol=0.05 * np.ptp(expected))


def test_faces_that_are_turned_every_way_have_no_curvature(body):
    faces = body.rest.faces.copy()
    faces[::2] = faces[::2, ::-1]
    found = basis(Mesh(body.rest.vertices, faces), 20)
    assert found.curvature is None
    assert found.orientation is None


def test_another_person_is_not_turned_about():
    """The map that is turned about the long axis preserves lengths and orientation as well."""
    pipeline = Pipeline()
    bodies = [make_body("person", number, vertices=1500) for number in (0, 3)]
    first, second = (
        PreparedMesh.of(body.posed(number), pipeline) for body, number in zip(bodies, (0, 3), strict=True)
    )
    distances = surface_distances(bodies[1])
    _, found = dense_map(first, second, pipeline)
    truth = individual_partners(*bodies)[0]
    assert distances[found, truth].mean() < 0.05


def test_the_mirror_image_of_a_pose_is_told():
    """Left and right of a body differ by a few per cent: only the exact truth reverses orientation."""
    pipeline = Pipeline()
    body, other = (make_body("spider", 0, vertices=count) for count in (800, 900))
    posed = other.posed(1)
    image = Mesh(posed.vertices * (1.0, 1.0, -1.0), posed.faces[:, ::-1])
    truth, distances = body.partners(other)[0], surface_distances(other)
    first = PreparedMesh.of(body.posed(0), pipeline)
    for mesh, mirrored in ((posed, False), (image, True)):
        found, partners = dense_map(first, PreparedMesh.of(mesh, pipeline), pipeline)
        assert found.mirrored is mirrored
        assert found.fitting == 1
        assert distances[partners, truth].mean() < 0.03


@pytest.mark.parametrize("scale", [1.0, 1e12, 1e-12])
def test_the_rows_are_those_of_a_tree(scale):
    rng = np.random.default_rng(4)
    ours, theirs = scale * rng.normal(size=(2500, 6)), scale * rng.normal(size=(1300, 6))
    there, back = nearest_both_ways(ours, theirs)
    np.testing.assert_array_equal(there, cKDTree(theirs).query(ours)[1])
    np.testing.assert_array_equal(back, cKDTree(ours).query(theirs)[1])
