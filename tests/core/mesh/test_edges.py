"""Half-edges, boundary loops and components of triangulations."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.mesh.edges import boundary_edges, boundary_half_edges, boundary_loops, component_labels, half_edges
from core.mesh.mesh import Mesh
from tests.core.shapes import MANY_KINDS, icosphere, joined, rectangle


@pytest.mark.parametrize("kind", MANY_KINDS)
def test_half_edges_are_sorted_by_their_ends_and_boundary_edges_are_those_of_one_face(kind):
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
    np.testing.assert_array_equal(boundary_edges(sides), edges[counts == 1])
    directed = boundary_half_edges(faces, sides)
    np.testing.assert_array_equal(np.sort(directed, axis=1), edges[counts == 1])
    assert set(map(tuple, directed.tolist())) <= set(map(tuple, ends.tolist()))


DRAWN = {
    f"{count} triangles": np.random.default_rng(count).integers(0, 200, size=(count, 3))
    for count in (3, 30, 90, 300)
}


@pytest.mark.parametrize("kind", [*MANY_KINDS, *DRAWN])
def test_parts_are_scipys(kind):
    faces = DRAWN[kind] if kind in DRAWN else MANY_KINDS[kind]().faces
    count = int(faces.max()) + 1
    rows, columns = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    found, expected = component_labels(count, faces), connected_components(links, directed=False)
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def walked(edges):
    """The loops of directed edges, as sets of their edges; those that meet other edges are left out."""
    after = {}
    for start, end in edges:
        after.setdefault(start, []).append(end)
    loops, seen = [], set()
    for first in sorted(after):
        loop, at = [], first
        while at not in seen and len(after.get(at, [])) == 1:
            seen.add(at)
            loop.append((at, after[at][0]))
            at = after[at][0]
        if loop and at == first:
            loops.append(set(loop))
    return loops


def punctured(*faces):
    """A sphere without some of its faces."""
    ball = icosphere(3)
    return Mesh(ball.vertices, np.delete(ball.faces, faces, axis=0))


OPEN = {
    "sheet": rectangle(2.0, 1.0, 5, 3),
    "three holes": punctured(3, 400, 900),
    "sheet and holes": joined(punctured(7, 800), rectangle(2.0, 1.0, 5, 3)),
}


@pytest.mark.parametrize("kind", OPEN)
def test_loops_are_those_of_a_walk_along_the_edges(kind):
    mesh = OPEN[kind]
    edges = boundary_half_edges(mesh.faces, half_edges(mesh.faces))
    loops = boundary_loops(edges, len(mesh.vertices))
    wanted = walked(edges.tolist())
    assert len(wanted) == {"sheet": 1, "three holes": 3, "sheet and holes": 3}[kind]
    assert [{tuple(edge) for edge in edges[loops == i].tolist()} for i in range(loops.max() + 1)] == wanted
    assert (loops >= 0).all()


def test_a_closed_surface_has_no_boundary():
    ball = icosphere(2)
    edges = boundary_half_edges(ball.faces, half_edges(ball.faces))
    assert edges.shape == (0, 2)
    assert boundary_loops(edges, len(ball.vertices)).shape == (0,)


def test_boundaries_that_touch_in_a_vertex_are_no_loops():
    """Two triangles that share one vertex, beside a triangle by itself."""
    faces = np.array([[0, 1, 2], [0, 3, 4], [5, 6, 7]])
    edges = boundary_half_edges(faces, half_edges(faces))
    loops = boundary_loops(edges, 8)
    assert all((loop == 0) == (edge >= 5).all() for edge, loop in zip(edges, loops, strict=True))
    assert set(loops.tolist()) == {-1, 0}


def test_faces_of_opposite_orientations_have_no_loop():
    """Both faces run from vertex 1 to vertex 2, so two half-edges of the boundary begin at vertex 2."""
    faces = np.array([[0, 1, 2], [1, 2, 3]])
    edges = boundary_half_edges(faces, half_edges(faces))
    assert boundary_loops(edges, 4).tolist() == [-1, -1, -1, -1]
