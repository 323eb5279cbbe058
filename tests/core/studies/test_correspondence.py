"""The error of a correspondence, on truths made by hand, and a whole study of one body."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from core.gallery.bodies import make_body
from core.graph.edge_graph import edge_graph
from core.mesh.cleaning import face_areas
from core.parameters import DEFAULT
from core.studies.correspondence import (
    MOST_ERROR,
    study_body,
    study_individuals,
    surface_distances,
    symmetric_error,
)


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


@pytest.mark.parametrize("remeshed", [False, True])
def test_poses_of_pliers_are_matched_rightly(remeshed):
    found = study_body("pliers", 0, 2, DEFAULT, remeshed=remeshed)
    assert [(pair.first, pair.second) for pair in found.pairs] == [(0, 1), (1, 0)]
    assert found.vertices == pytest.approx(np.mean([pair.vertices for pair in found.pairs]))
    assert found.samples == pytest.approx(np.mean([pair.samples for pair in found.pairs]))
    assert found.direct == pytest.approx(np.mean([pair.direct for pair in found.pairs]))
    for pair in found.pairs:
        if pair.symmetry == 0:
            assert pair.direct == pytest.approx(pair.vertices)
        else:
            assert pair.direct > pair.vertices
    assert max(pair.vertices for pair in found.pairs) <= MOST_ERROR
    assert all(pair.cc > 0.9 for pair in found.pairs)


def test_individuals_are_matched_each_with_each_other():
    found = study_individuals("hand", 2, DEFAULT)
    assert [(pair.first, pair.second) for pair in found.pairs] == [(0, 1), (1, 0)]
    assert found.body is None
    assert all(pair.vertices <= pair.direct + 1e-9 for pair in found.pairs)
    assert found.vertices <= MOST_ERROR
