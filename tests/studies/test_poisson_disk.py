"""Poisson-disk sets: the radius is kept, nothing more fits in, and the number is the one asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist

from core.errors import ParameterError
from core.gallery import make_shape
from core.graph.edge_graph import edge_graph
from tests.studies.poisson_disk import poisson_disk, poisson_disk_of


def points_and_order(count, seed):
    random = np.random.default_rng(seed)
    points = random.random((count, 2))
    return cdist(points, points), random.permutation(count)


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 120), st.floats(0.0, 2.0), st.integers(0, 10_000))
def test_samples_keep_the_radius_and_leave_no_room(count, radius, seed):
    distances, order = points_and_order(count, seed)
    samples = poisson_disk(distances, radius, order)
    between = distances[np.ix_(samples, samples)]
    assert len(set(samples.tolist())) == len(samples)
    assert (between[~np.eye(len(samples), dtype=bool)] >= radius).all()
    assert ((distances[samples] < radius).any(axis=0) | np.isin(np.arange(count), samples)).all()


def test_darts_fall_in_the_order_given():
    places = np.arange(7.0)[:, None]
    distances = cdist(places, places)
    assert poisson_disk(distances, 2.0, np.arange(7)).tolist() == [0, 2, 4, 6]
    assert poisson_disk(distances, 2.0, np.array([3, 0, 1, 2, 4, 5, 6])).tolist() == [3, 0, 5]
    assert poisson_disk(distances, 2.5, np.arange(7)).tolist() == [0, 3, 6]


def test_radius_zero_takes_all_and_a_large_one_takes_the_first():
    distances, order = points_and_order(30, 1)
    assert poisson_disk(distances, 0.0, order).tolist() == order.tolist()
    assert poisson_disk(distances, 2.0, order).tolist() == order[:1].tolist()


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 150), st.data())
def test_as_many_as_asked_at_least_a_radius_apart(count, data):
    wanted = data.draw(st.integers(1, count))
    distances, order = points_and_order(count, data.draw(st.integers(0, 10_000)))
    samples, radius = poisson_disk_of(distances, wanted, order)
    between = distances[np.ix_(samples, samples)][~np.eye(wanted, dtype=bool)]
    assert len(set(samples.tolist())) == wanted
    assert (between >= radius).all()


def test_the_radius_is_the_largest_that_fills_the_number():
    distances, order = points_and_order(400, 5)
    samples, radius = poisson_disk_of(distances, 60, order)
    assert len(poisson_disk(distances, 1.2 * radius, order)) < 60
    # Of random throws on a square the spacing is 0.6 to 0.9 of the densest packing's, 1.0746 / sqrt(m).
    assert 0.6 < radius / (1.0746 / np.sqrt(len(samples))) < 0.9


def test_on_a_mesh_the_spacing_is_even_and_every_vertex_near():
    distances = dijkstra(edge_graph(make_shape("cup", 1)))
    distances = np.minimum(distances, distances.T)
    order = np.random.default_rng(2).permutation(len(distances))
    samples, radius = poisson_disk_of(distances, 100, order)
    between = distances[np.ix_(samples, samples)]
    np.fill_diagonal(between, np.inf)
    assert between.min() >= radius
    # Only the few left out for the number can leave a gap wider than the radius, and none twice as wide.
    assert distances[samples].min(axis=0).max() < 2.0 * radius


@pytest.mark.parametrize("count", [0, -1, 11])
def test_a_number_that_cannot_be_is_refused(count):
    distances, order = points_and_order(10, 0)
    with pytest.raises(ParameterError, match="cannot be taken"):
        poisson_disk_of(distances, count, order)
