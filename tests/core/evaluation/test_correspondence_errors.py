"""Errors of correspondences, on truths made by hand and on bodies whose truth is known by construction."""

from functools import partial
from itertools import permutations

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from core.dense.functional_maps import FUNCTIONS
from core.errors import ParameterError
from core.evaluation import correspondence_errors
from core.evaluation.correspondence_errors import (
    MEASURED,
    MOST_ERROR,
    dense_map,
    drawn_pairs,
    known_mesh,
    measured_vertices,
    study_body,
    study_individuals,
    surface_distances,
    symmetric_error,
    truth_errors,
)
from core.graph.edge_graph import edge_graph
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from tests.gallery import make_body

PIPELINE = Pipeline()


@pytest.fixture(scope="module")
def bodies():
    """Two poses of a body, with the vertices of its mesh as the template, and their mirror images."""
    body = make_body("quadruped", 0, vertices=900)
    chosen = measured_vertices(len(body.rest.vertices), 0)
    truth = body.partners(body)[:, chosen]
    return [known_mesh(body.posed(pose), truth, PIPELINE) for pose in (0, 1)]


def test_measured_vertices_are_distinct_and_depend_on_the_seed():
    chosen = measured_vertices(1000, 0)
    assert len(set(chosen.tolist())) == len(chosen) == MEASURED
    assert chosen.max() < 1000
    np.testing.assert_array_equal(chosen, measured_vertices(1000, 0))
    assert not np.array_equal(chosen, measured_vertices(1000, 1))
    np.testing.assert_array_equal(measured_vertices(7, 0), np.arange(7))


def test_distances_are_geodesic_over_the_root_of_the_area(bodies):
    known = bodies[0]
    root = np.sqrt(face_areas(known.mesh.vertices, known.mesh.faces).sum())
    expected = dijkstra(edge_graph(known.mesh), indices=known.truth[1, 5]) / root
    np.testing.assert_allclose(known.distances[1, 5], expected, rtol=1e-6)


def test_the_truth_has_no_error_and_its_mirror_image_none_up_to_symmetry(bodies):
    first, second = bodies
    found = np.zeros(len(first.mesh.vertices), dtype=np.int64)
    found[first.truth[0]] = second.truth[0]
    errors = truth_errors(first, second, found)
    assert (errors.direct, errors.symmetric) == (0.0, 0.0)
    found[first.truth[0]] = second.truth[1]
    errors = truth_errors(first, second, found)
    assert errors.symmetric == 0.0
    assert errors.direct > 0.1


def test_the_truth_follows_the_vertices_of_the_file():
    """Cleaning renumbers the vertices and merges the last two, which coincide."""
    mesh = make_body("pliers", 0, vertices=400).posed(0)
    doubled = Mesh(np.vstack([mesh.vertices, mesh.vertices[-1:]]), mesh.faces)
    truth = np.array([[3, 17, len(mesh.vertices)]])
    known = known_mesh(doubled, truth, PIPELINE)
    np.testing.assert_allclose(known.mesh.vertices[known.truth], doubled.vertices[truth], atol=1e-6)


def test_the_dense_correspondence_of_two_poses(bodies):
    errors = truth_errors(*bodies, dense_map(*bodies, PIPELINE)[1])
    assert errors.symmetric <= 0.06
    assert errors.direct >= errors.symmetric


def test_a_vertex_that_is_none_of_the_mesh():
    mesh = make_body("pliers", 0, vertices=400).posed(0)
    for vertex in (-1, len(mesh.vertices)):
        with pytest.raises(ParameterError, match="none of the mesh"):
            known_mesh(mesh, np.array([[0, vertex]]), PIPELINE)


def test_pairs_share_a_template_and_are_drawn_once():
    classes = ["a", "a", "a", "b", "b", "c"]
    templates = ["t", "t", "t", "t", "t", "c"]
    same, different = drawn_pairs(classes, templates, 100, 0)
    assert same == sorted([*permutations(range(3), 2), *permutations((3, 4), 2)])
    assert len(different) == len(set(different)) == 2 * 3 * 2
    assert all(classes[i] != classes[j] and 5 not in (i, j) for i, j in different)
    few, _ = drawn_pairs(classes, templates, 3, 0)
    assert len(few) == 3
    assert set(few) < set(same)
    assert drawn_pairs(classes, templates, 3, 0) == drawn_pairs(classes, templates, 3, 0)
    assert {tuple(drawn_pairs(classes, templates, 3, seed)[0]) for seed in range(9)} != {tuple(few)}


def test_the_error_is_the_least_over_the_symmetries():
    places = np.array([0.0, 1.0, 2.0, 3.0])
    distances = np.abs(places[:, None] - places)
    partners = np.array([[0, 1, 2, 3], [3, 2, 1, 0]])
    everywhere = np.arange(4)
    assert symmetric_error(distances, partners, everywhere, np.array([0, 1, 2, 3])) == (0.0, 0)
    assert symmetric_error(distances, partners, everywhere, np.array([3, 2, 1, 0])) == (0.0, 1)
    assert symmetric_error(distances, partners, everywhere, np.array([3, 2, 1, 1])) == (0.25, 1)
    assert symmetric_error(distances, partners, np.array([2]), np.array([0])) == (1.0, 1)


def test_distances_are_in_units_of_the_root_of_the_area():
    body = make_body("pliers", vertices=500)
    found = surface_distances(body)
    root = np.sqrt(face_areas(body.rest.vertices, body.rest.faces).sum())
    assert found[0] == pytest.approx(dijkstra(edge_graph(body.rest), indices=0) / root)
    np.testing.assert_array_equal(found, found.T)


@pytest.fixture
def small_bodies(monkeypatch):
    """The studies of bodies at full size, and of more functions, are among those of the command."""
    monkeypatch.setattr(correspondence_errors, "FINE", FUNCTIONS)
    monkeypatch.setattr(correspondence_errors, "make_body", partial(make_body, vertices=1000))
    monkeypatch.setattr(correspondence_errors, "REMESHED", 850)


@pytest.mark.usefixtures("small_bodies")
@pytest.mark.parametrize("remeshed", [False, True])
def test_poses_of_pliers_are_matched_rightly(remeshed):
    found = study_body("pliers", 0, 2, DEFAULT, remeshed=remeshed)
    assert [(pair.first, pair.second) for pair in found.pairs] == [(0, 1), (1, 0)]
    assert found.mean("vertices") == pytest.approx(np.mean([pair.vertices for pair in found.pairs]))
    for pair in found.pairs:
        if pair.symmetry == 0:
            assert pair.direct == pytest.approx(pair.vertices)
        else:
            assert pair.direct > pair.vertices
    assert max(pair.vertices for pair in found.pairs) <= MOST_ERROR
    assert all(pair.cc > 0.9 for pair in found.pairs)


@pytest.mark.usefixtures("small_bodies")
def test_individuals_are_matched_each_with_each_other():
    found = study_individuals("hand", 2, DEFAULT)
    assert [(pair.first, pair.second) for pair in found.pairs] == [(0, 1), (1, 0)]
    assert found.body is None
    assert all(pair.vertices <= pair.direct + 1e-9 for pair in found.pairs)
    assert found.mean("vertices") <= MOST_ERROR
