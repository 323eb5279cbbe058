"""Searches by buckets against SciPy's."""

import numpy as np
import pytest

from core.graph.edge_graph import edge_graph, symmetric
from core.graph.geodesics import WIDTH, _search, geodesic_distances, geodesics, geodesics_reference
from core.mesh.cleaning import clean
from tests.core.shapes import MANY_KINDS


@pytest.mark.parametrize("name", MANY_KINDS)
def test_lengths_are_scipys_to_the_last_bit(name):
    graph = edge_graph(clean(MANY_KINDS[name]()).mesh)
    drawn = np.random.default_rng(0).permutation(graph.shape[0])
    samples, points = drawn[:20], drawn[:70]
    found = geodesics(graph, samples, points)
    np.testing.assert_array_equal(found, geodesics_reference(graph, samples, points))
    assert (np.diagonal(found) == 0.0).all()


def many_lengths():
    """A path of 200 vertices with a shortcut at every second: lengths over five powers of ten."""
    steps = np.arange(199)
    edges = np.concatenate([np.stack([steps, steps + 1], 1), np.stack([steps[:-1], steps[:-1] + 2], 1)])
    lengths = 10.0 ** np.random.default_rng(3).uniform(-5.0, 0.0, size=len(edges))
    return symmetric(edges, lengths, 200)


def search(graph, width, samples, points, found):
    indptr, indices = graph.indptr.astype(np.uint32), graph.indices.astype(np.uint32)
    return _search(indptr, indices, graph.data, width, samples, points, found)


@pytest.mark.parametrize("width", [1e-4, 1e-2, 1.0, 100.0])
def test_the_width_of_a_bucket_changes_the_work_alone(width):
    graph = many_lengths()
    samples, points = np.array([0, 77, 199]), np.arange(200)
    found = np.full((200, 3), np.nan)
    done = search(graph, width, samples, points, found)
    wanted = geodesics_reference(graph, samples, points)
    np.testing.assert_array_equal(found[:, :done], wanted[:, :done])
    assert np.isnan(found[:, done:]).all()
    np.testing.assert_array_equal(geodesics(graph, samples, points), wanted)


def test_a_search_that_goes_astray_is_left_to_scipy():
    """A path is shorter the more steps it has, all in one bucket: a vertex is lowered again and again."""
    edges, lengths = [(200, 201)], [1e6]
    for step in (1, 2, 3):
        edges += [(i, i + step) for i in range(201 - step)]
        lengths += [float(step**2)] * (201 - step)
    graph = symmetric(np.array(edges), np.array(lengths), 202)
    samples, points = np.array([0, 201, 30]), np.arange(202)
    found = np.empty((202, 3))
    width = WIDTH * float(graph.data.mean())
    assert search(graph, width, samples, points, found) == 0
    np.testing.assert_array_equal(
        geodesics(graph, samples, points), geodesics_reference(graph, samples, points)
    )


def test_between_the_samples_they_are_symmetric():
    graph = many_lengths()
    distances = geodesic_distances(graph, np.arange(0, 200, 9))
    np.testing.assert_array_equal(distances, distances.T)
