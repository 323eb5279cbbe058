"""Searches by buckets, and the growing farthest-point pass, against SciPy's."""

import numpy as np
import pytest

from core.graph.edge_graph import edge_graph, symmetric
from core.graph.geodesics import (
    _arrays,
    _search,
    _select,
    farthest_points,
    farthest_points_reference,
    geodesics,
    geodesics_reference,
)
from core.mesh.cleaning import clean
from tests.core.shapes import GALLERY, MANY_KINDS


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


@pytest.mark.parametrize("width", [1e-4, 1e-2, 1.0, 100.0])
def test_the_width_of_a_bucket_changes_the_work_alone(width):
    graph = many_lengths()
    samples, points = np.array([0, 77, 199]), np.arange(200)
    found = np.full((200, 3), np.nan)
    done = _search(*_arrays(graph)[:3], width, samples, points, found)
    wanted = geodesics_reference(graph, samples, points)
    np.testing.assert_array_equal(found[:, :done], wanted[:, :done])
    assert np.isnan(found[:, done:]).all()
    np.testing.assert_array_equal(geodesics(graph, samples, points), wanted)


def astray():
    """A graph in which a path is shorter the more steps it has, all in one bucket."""
    edges, lengths = [(200, 201)], [1e6]
    for step in (1, 2, 3):
        edges += [(i, i + step) for i in range(201 - step)]
        lengths += [float(step**2)] * (201 - step)
    return symmetric(np.array(edges), np.array(lengths), 202)


def test_a_search_that_goes_astray_is_left_to_scipy():
    """A vertex is lowered again and again."""
    graph = astray()
    samples, points = np.array([0, 201, 30]), np.arange(202)
    found = np.empty((202, 3))
    assert _search(*_arrays(graph), samples, points, found) == 0
    np.testing.assert_array_equal(
        geodesics(graph, samples, points), geodesics_reference(graph, samples, points)
    )


KINDS = [*GALLERY[:6], "soup", "loose parts", "sphere", "sheet"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_fast_pass_is_the_slow_one(kind):
    graph = edge_graph(MANY_KINDS[kind]())
    count, first = min(40, graph.shape[0]), graph.shape[0] // 3
    drawn = np.random.default_rng(1).uniform(0.25, 4.0, size=graph.shape[0])
    plain, weighted = (farthest_points(graph, count, first, weights) for weights in (None, drawn))
    np.testing.assert_array_equal(plain, farthest_points_reference(graph, count, first))
    np.testing.assert_array_equal(weighted, farthest_points_reference(graph, count, first, drawn))
    assert not np.array_equal(weighted, plain)


def test_a_path_is_halved_and_halved_again_and_a_heavy_vertex_is_taken_before_a_far_one():
    """Vertices 0 .. 8 at unit steps, from one end: the other end, the middle, the quarters."""
    steps = np.arange(8)
    graph = symmetric(np.stack([steps, steps + 1], axis=1), np.ones(8), 9)
    np.testing.assert_array_equal(farthest_points(graph, 9, 0), [0, 8, 4, 2, 6, 1, 3, 5, 7])
    weights = np.ones(9)
    weights[3] = 4.0
    np.testing.assert_array_equal(farthest_points(graph, 3, 0, weights), [0, 3, 8])


@pytest.mark.parametrize("weighted", [False, True])
def test_all_vertices_are_taken_once(weighted):
    graph = edge_graph(MANY_KINDS["loose parts"]())
    weights = np.random.default_rng(3).uniform(0.25, 4.0, size=graph.shape[0]) if weighted else None
    for search in (farthest_points, farthest_points_reference):
        samples = search(graph, graph.shape[0] + 10, 2, weights)
        np.testing.assert_array_equal(np.sort(samples), np.arange(graph.shape[0]))


def test_rounding_does_not_choose_between_equals():
    """Four ends of a cross: with lengths off by 1e-7 the first of them still goes first."""
    edges = np.array([[0, 1], [0, 2], [0, 3], [0, 4]])
    lengths = np.array([1.0, 1.0 + 1e-7, 1.0 - 1e-7, 1.0 + 2e-7])
    graph = symmetric(edges, lengths, 5)
    for search in (farthest_points, farthest_points_reference):
        np.testing.assert_array_equal(search(graph, 5, 0), [0, 1, 2, 3, 4])


def test_a_selection_that_goes_astray_is_left_to_scipy():
    graph = astray()
    assert not _select(*_arrays(graph), np.ones(202), 0, np.empty(20, dtype=np.int64))
    np.testing.assert_array_equal(farthest_points(graph, 20, 0), farthest_points_reference(graph, 20, 0))
