"""Simplification and edge contraction: fewer vertices, the same surface."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from core.evaluation.perturbation import subdivide
from core.mesh import simplification as module
from core.mesh.cleaning import clean, face_areas
from core.mesh.edges import boundary_edges, component_labels, half_edges
from core.mesh.mesh import Mesh
from core.mesh.simplification import FINENESS, MOST_WORK, _quadrics, contract_edges, simplify
from tests.core.shapes import box, icosphere, joined, shifted, turned

WANTED = 600


def fine(mesh):
    while len(mesh.vertices) <= FINENESS * WANTED:
        mesh = subdivide(mesh, 1.0, 0)
    return mesh


def area(vertices, faces):
    return face_areas(vertices, faces).sum()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("extents", [(3, 2, 1), (3, 2, 0.3)])
def test_flat_sides_of_a_large_mesh_become_few_faces(extents, seed):
    # Quadric collapses that stop on flat sides would go on elsewhere, and remove the shape.
    block = fine(turned(box(*extents), seed))
    small = simplify(block, WANTED)
    assert abs(len(small.vertices) - WANTED) < 0.05 * WANTED
    assert area(small.vertices, small.faces) == pytest.approx(area(block.vertices, block.faces), rel=0.01)


def crowded(count, kind):
    """Triangles around a point, apart from each other ("thistle") or not ("fan"), or around an edge."""
    turns = np.linspace(0.0, 1.5 * np.pi, count + 1)
    rim = np.stack([np.cos(turns), np.sin(turns), 0.3 * np.sin(5.0 * turns)], axis=1)
    here = np.arange(count)
    if kind == "thistle":
        rim = np.concatenate([1.01 * rim[:count] + (0.0, 0.0, 0.01), rim])
    second = {"fan": 2 + here, "thistle": 1 + count + here, "book": 0 * here + count + 2}[kind]
    return Mesh(
        np.concatenate([np.zeros((1, 3)), rim, [[0.0, 0.0, 1.0]]]),
        np.stack([0 * here, 1 + here, second], axis=1),
    )


@pytest.mark.parametrize("kind", ["fan", "thistle", "book"])
def test_the_work_around_a_vertex_of_many_faces_is_limited_and_the_surface_stays(kind, monkeypatch):
    work, collapse = [], module.fast_simplification.simplify

    def counted(points, faces, **wanted):
        valences = np.bincount(faces.ravel()).astype(float)
        work.append(valences @ valences)
        return collapse(points, faces, **wanted)

    monkeypatch.setattr(module.fast_simplification, "simplify", counted)
    mesh = clean(crowded(40_000, kind)).mesh
    small = simplify(mesh, WANTED)
    assert max(work, default=0.0) <= MOST_WORK
    assert len(small.vertices) < 2 * WANTED
    for extreme in (np.min, np.max):
        assert extreme(small.vertices, axis=0) == pytest.approx(extreme(mesh.vertices, axis=0), abs=0.1)


def test_plates_close_to_each_other_stay_apart():
    ball = icosphere(5)
    plate = Mesh(ball.vertices * (1, 1, 0.01), ball.faces)
    pile = joined(*(shifted(plate, (0, 0, 0.03 * i)) for i in range(3)))
    small = clean(simplify(pile, WANTED))
    assert small.components == 3
    assert area(small.mesh.vertices, small.mesh.faces) == pytest.approx(
        area(pile.vertices, pile.faces), rel=0.02
    )


def test_the_same_mesh_gives_the_same_bytes():
    mesh = fine(turned(icosphere(4), 1))
    first, second = simplify(mesh, WANTED), simplify(Mesh(mesh.vertices, mesh.faces), WANTED)
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()


@pytest.mark.parametrize("most", [400, 1000, 3000])
def test_contraction_ends_between_half_of_the_number_and_all_of_it(most):
    ball = icosphere(5)
    points, faces = contract_edges(ball.vertices, ball.faces, most)
    assert most / 2 <= len(points) <= most
    assert (np.abs(np.linalg.norm(points, axis=1) - 1.0) < 10.0 / most).all()
    assert area(points, faces) == pytest.approx(4.0 * np.pi, rel=20.0 / most)
    assert component_labels(len(points), faces)[0] == 1


def test_contracted_vertices_are_on_the_planes_near_the_middles_of_edges_or_stay():
    ball = icosphere(4)
    points, _ = contract_edges(ball.vertices, ball.faces, len(ball.vertices) - 1)
    ends = ball.vertices[half_edges(ball.faces).edges]
    middles, lengths = ends.mean(axis=1), np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    away, nearest = cKDTree(middles).query(points)
    moved = cKDTree(ball.vertices).query(points)[0] > 0.0
    assert (away[moved] < 0.1 * lengths[nearest[moved]]).all()
    assert np.linalg.norm(points[moved], axis=1).min() > np.linalg.norm(middles, axis=1).max()
    assert 0.3 * len(points) < moved.sum() < len(points) < 0.7 * len(ball.vertices)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("extents", [(3, 2, 1), (3, 2, 0.3)])
def test_contraction_keeps_ridges_and_corners(extents, seed):
    coarse = block = turned(box(*extents), seed)
    for _ in range(5):
        block = subdivide(block, 1.0, 0)
    points, faces = contract_edges(block.vertices, block.faces, 2_400)
    assert len(points) <= 2_400 < len(block.vertices)
    assert area(points, faces) == pytest.approx(area(block.vertices, block.faces), rel=0.002)
    side = np.sqrt(area(points, faces) / len(points))
    assert cKDTree(points).query(coarse.vertices)[0].max() < 0.1 * side


def test_the_quadric_error_is_the_squared_distance_from_the_planes():
    rng = np.random.default_rng(0)
    points, faces = rng.normal(size=(4, 3)), np.array([[0, 1, 2], [0, 3, 1]])
    found = _quadrics(points, faces)
    for vertex, beside in ((0, faces), (2, faces[:1])):
        upper, linear = found[vertex, :6], found[vertex, 6:]
        matrix = np.zeros((3, 3))
        matrix[np.triu_indices(3)] = upper
        matrix += np.triu(matrix, 1).T
        away = rng.normal(size=3)
        expected = constant_term = 0.0
        for corners in points[beside]:
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            size = np.linalg.norm(normal)
            expected += size * ((away - corners[0]) @ normal / size) ** 2
            constant_term += size * (corners[0] @ normal / size) ** 2
        assert away @ matrix @ away - 2.0 * linear @ away + constant_term == pytest.approx(expected)


def test_a_coarse_part_keeps_its_vertices():
    coarse, dense = shifted(box(4, 4, 4), (9, 0, 0)), icosphere(6)
    mesh = joined(dense, coarse)
    points, _ = contract_edges(mesh.vertices, mesh.faces, 10_000)
    assert len(points) <= 10_000
    assert cKDTree(points).query(coarse.vertices)[0].max() == 0.0


def test_a_mesh_of_no_more_vertices_is_not_contracted():
    ball = icosphere(3)
    points, faces = contract_edges(ball.vertices, ball.faces, len(ball.vertices))
    assert points is ball.vertices
    assert faces is ball.faces


def test_pieces_without_common_edges_are_not_contracted_away():
    # Five vertices of which every three are a face: two rounds would leave one edge of each.
    rng = np.random.default_rng(0)
    corners = np.array([[a, b, c] for a in range(5) for b in range(a) for c in range(b)])
    points = rng.random((500, 1, 3)) * 100.0 + rng.random((500, 5, 3))
    faces = corners + 5 * np.arange(500)[:, None, None]
    _, left = contract_edges(points.reshape(-1, 3), faces.reshape(-1, 3), 1000)
    assert len(left) > 0


def test_the_boundary_of_an_open_surface_stays():
    ball = icosphere(5)
    upper = ball.faces[(ball.vertices[ball.faces][:, :, 2] > -0.3).all(axis=1)]
    bowl = clean(Mesh(ball.vertices, upper)).mesh
    points, faces = contract_edges(bowl.vertices, bowl.faces, 2_000)
    before, after = (np.unique(boundary_edges(half_edges(some))) for some in (bowl.faces, faces))
    assert len(points) <= 2_000 < len(bowl.vertices)
    assert np.array_equal(np.sort(bowl.vertices[before], axis=0), np.sort(points[after], axis=0))
    assert area(points, faces) == pytest.approx(area(bowl.vertices, bowl.faces), rel=0.002)


def test_a_surface_of_boundaries_alone_is_contracted_all_the_same():
    count = 5_000
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    rim = np.stack([np.cos(turns), np.sin(turns), 0.3 * np.sin(5.0 * turns)], axis=1)
    here = np.arange(count)
    faces = np.stack([np.zeros(count, dtype=np.int64), here + 1, (here + 1) % count + 1], axis=1)
    points, _ = contract_edges(np.concatenate([np.zeros((1, 3)), rim]), faces, 1_000)
    assert len(points) <= 1_000
