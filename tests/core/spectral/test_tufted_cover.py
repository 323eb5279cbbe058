"""The tufted cover is closed and oriented, and has each face twice."""

import numpy as np
import pytest

from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.spectral.delaunay import tufted_cover
from tests.core.shapes import MANY_KINDS, box, icosphere, rectangle, soup

BALL = icosphere(1)
SURFACES = {
    "sheet": rectangle(1.0, 1.0, 4, 4),
    "three sheets on an edge": MANY_KINDS["three sheets on an edge"](),
    "one face turned over": Mesh(BALL.vertices, np.r_[BALL.faces[:1, ::-1], BALL.faces[1:]]),
    "soup": soup(BALL),
    "closed": box(1.0, 2.0, 3.0),
    "three sheets on an edge of length 0": Mesh(
        [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    ),
}


@pytest.mark.parametrize("kind", SURFACES)
def test_every_half_edge_has_a_twin_that_runs_the_other_way(kind):
    mesh = SURFACES[kind]
    faces, twin = tufted_cover(mesh.vertices, mesh.faces, half_edges(mesh.faces))
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    np.testing.assert_array_equal(twin[twin], np.arange(len(twin)))
    np.testing.assert_array_equal(start[twin], end)
    np.testing.assert_array_equal(np.sort(faces, axis=1), np.sort(np.tile(mesh.faces, (2, 1)), axis=1))


def test_a_closed_surface_is_covered_by_two_sheets():
    mesh = SURFACES["closed"]
    _, twin = tufted_cover(mesh.vertices, mesh.faces, half_edges(mesh.faces))
    half = 3 * len(mesh.faces)
    assert (twin[:half] < half).all()


def test_a_face_is_glued_to_the_next_one_around_the_edge():
    """Four sheets on the edge 0-1, listed across the circle: the gluing pairs neighbours."""
    around = {2: 0.0, 3: 2.0, 4: 1.0, 5: 3.0}
    angles = 0.5 * np.pi * np.array(list(around.values()))
    vertices = np.r_[
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    ]
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4], [0, 1, 5]])
    cover, twin = tufted_cover(vertices, faces, half_edges(faces))
    on_edge = np.flatnonzero(np.isin(cover.ravel(), [0, 1]) & np.isin(cover[:, [1, 2, 0]].ravel(), [0, 1]))
    opposite = cover[:, [2, 0, 1]].ravel()
    steps = [around[int(opposite[twin[h]])] - around[int(opposite[h])] for h in on_edge]
    assert len(steps) == 8
    assert set(np.mod(steps, 4.0)) == {1.0, 3.0}
