"""Simplification of large meshes: the surface stays, and so do its pieces and its coarse parts."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from core.mesh.cleaning import clean, face_areas
from core.mesh.edges import component_labels, half_edges
from core.mesh.mesh import Mesh
from core.mesh.simplification import FINENESS, contract_edges, simplify
from core.studies.perturbation import subdivide
from tests.core.shapes import box, icosphere, joined, shifted, turned

WANTED = 600


def fine(mesh):
    while len(mesh.vertices) <= FINENESS * WANTED:
        mesh = subdivide(mesh, 1.0, 0)
    return mesh


def area(vertices, faces):
    return face_areas(vertices, faces).sum()


@pytest.mark.parametrize("most", [400, 1000, 3000])
def test_contraction_ends_between_half_of_the_number_and_all_of_it(most):
    ball = icosphere(5)
    points, faces = contract_edges(ball.vertices, ball.faces, most)
    assert most / 2 <= len(points) <= most
    assert (np.abs(np.linalg.norm(points, axis=1) - 1.0) < 10.0 / most).all()
    assert area(points, faces) == pytest.approx(4.0 * np.pi, rel=20.0 / most)
    assert component_labels(len(points), faces)[0] == 1


def test_contracted_vertices_are_the_middles_of_edges_or_stay():
    ball = icosphere(4)
    points, _ = contract_edges(ball.vertices, ball.faces, len(ball.vertices) - 1)
    middles = ball.vertices[half_edges(ball.faces).edges].mean(axis=1)
    assert cKDTree(np.concatenate([ball.vertices, middles])).query(points)[0].max() < 1e-12
    assert len(points) < 0.7 * len(ball.vertices)


def test_a_coarse_part_keeps_its_vertices():
    coarse, dense = shifted(box(4, 4, 4), (9, 0, 0)), icosphere(6)
    mesh = joined(dense, coarse)
    points, _ = contract_edges(mesh.vertices, mesh.faces, 10_000)
    assert len(points) <= 10_000
    assert cKDTree(points).query(coarse.vertices)[0].max() == 0.0


def test_a_mesh_of_one_vertex_less_is_not_contracted():
    ball = icosphere(3)
    points, faces = contract_edges(ball.vertices, ball.faces, len(ball.vertices))
    assert points is ball.vertices
    assert faces is ball.faces


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("extents", [(3, 2, 1), (3, 2, 0.3)])
def test_flat_sides_of_a_large_mesh_become_few_faces(extents, seed):
    # Quadric collapses that stop on flat sides would go on elsewhere, and remove the shape.
    block = fine(turned(box(*extents), seed))
    small = simplify(block, WANTED)
    assert abs(len(small.vertices) - WANTED) < 0.05 * WANTED
    assert area(small.vertices, small.faces) == pytest.approx(area(block.vertices, block.faces), rel=0.01)


def test_plates_close_to_each_other_stay_apart():
    ball = icosphere(5)
    plate = Mesh(ball.vertices * (1, 1, 0.01), ball.faces)
    pile = joined(*(shifted(plate, (0, 0, 0.03 * i)) for i in range(3)))
    small = clean(simplify(pile, WANTED))
    assert small.components == 3
    assert area(small.mesh.vertices, small.mesh.faces) == pytest.approx(
        area(pile.vertices, pile.faces), rel=0.02
    )


def test_pieces_without_common_edges_are_not_contracted_away():
    # Five vertices of which every three are a face: two rounds would leave one edge of each.
    rng = np.random.default_rng(0)
    corners = np.array([[a, b, c] for a in range(5) for b in range(a) for c in range(b)])
    points = rng.random((500, 1, 3)) * 100.0 + rng.random((500, 5, 3))
    faces = corners + 5 * np.arange(500)[:, None, None]
    _, left = contract_edges(points.reshape(-1, 3), faces.reshape(-1, 3), 1000)
    assert len(left) > 0


def test_the_same_mesh_gives_the_same_bytes():
    mesh = fine(turned(icosphere(4), 1))
    first, second = simplify(mesh, WANTED), simplify(Mesh(mesh.vertices, mesh.faces), WANTED)
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()
