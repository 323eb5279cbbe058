"""Edges and parts against NumPy's and SciPy's."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.mesh.edges import component_labels, edge_order, half_edges
from tests.core.shapes import MANY_KINDS


@pytest.mark.parametrize("kind", MANY_KINDS)
def test_half_edges_are_sorted_by_their_ends(kind):
    faces = MANY_KINDS[kind]().faces
    sides = half_edges(faces)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    np.testing.assert_array_equal(np.sort(sides.order), np.arange(len(ends)))
    sorted_ends = np.sort(ends, axis=1)[sides.order]
    np.testing.assert_array_equal(np.stack([sides.low, sides.high], axis=1), sorted_ends)
    edges, counts = np.unique(sorted_ends, axis=0, return_counts=True)
    np.testing.assert_array_equal(sides.edges, edges)
    np.testing.assert_array_equal(sides.face_counts, counts)
    for start, count in zip(sides.first, sides.face_counts, strict=True):
        assert (np.diff(sides.order[start : start + count]) > 0).all()


def scipys(count, faces):
    rows, columns = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    return connected_components(links, directed=False)


@pytest.mark.parametrize("kind", MANY_KINDS)
def test_parts_are_scipys(kind):
    mesh = MANY_KINDS[kind]()
    found = component_labels(len(mesh.vertices), mesh.faces)
    for ours, theirs in zip(found, scipys(len(mesh.vertices), mesh.faces), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("triangles", [3, 30, 90, 300])
def test_parts_of_triangles_drawn_at_random(triangles):
    faces = np.random.default_rng(triangles).integers(0, 200, size=(triangles, 3))
    for ours, theirs in zip(component_labels(200, faces), scipys(200, faces), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("count", [0, 1, 500])
def test_edges_are_in_lexical_order(count):
    """Of 20 vertices: most edges occur several times, and some have both ends at one vertex."""
    ends = np.sort(np.random.default_rng(count).integers(20, size=(count, 2)), axis=1)
    np.testing.assert_array_equal(edge_order(ends[:, 0], ends[:, 1]), np.lexsort((ends[:, 1], ends[:, 0])))
