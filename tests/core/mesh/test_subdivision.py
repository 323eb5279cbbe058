"""Cutting long edges: the same surface, still closed, with short edges."""

import numpy as np
import pytest
from trimesh.proximity import closest_point_naive

from core.mesh.cleaning import face_areas
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.mesh.subdivision import refine, split_faces, split_long_edges
from tests.core.shapes import (
    area,
    as_trimesh,
    blob,
    box,
    faces_shuffled,
    folded,
    icosphere,
    loose_parts,
    rectangle,
    soup,
    turned,
)

CLOSED = {
    "box": box(3, 2, 1),
    "flat box": box(5, 3, 0.02),
    "blob": blob(subdivisions=2),
    "table": loose_parts(),
}
OPEN = {"sheet": rectangle(3, 1, 2, 1), "three sheets": folded(), "soup": soup(icosphere(1))}
NEEDLE = Mesh([[0, 0, 0], [100, 0, 0], [0, 0.01, 0]], [[0, 1, 2]])
ALL = {**CLOSED, **OPEN, "needle": NEEDLE}


def edge_lengths(mesh):
    edges = half_edges(mesh.faces).edges
    return np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)


def faces_on_edges(faces):
    """The numbers of faces that edges have."""
    return np.unique(half_edges(faces).face_counts).tolist()


def euler_number(mesh):
    return len(mesh.vertices) - len(half_edges(mesh.faces).edges) + len(mesh.faces)


@pytest.mark.parametrize("mesh", ALL.values(), ids=ALL)
@pytest.mark.parametrize("part", [0.5, 0.07])
def test_no_edge_is_longer_than_asked_and_the_area_stays(mesh, part):
    longest = part * edge_lengths(mesh).max()
    cut = split_long_edges(mesh, longest, 10**6)
    assert edge_lengths(cut).max() <= longest
    assert area(cut) == pytest.approx(area(mesh), rel=1e-12)
    assert face_areas(cut.vertices, cut.faces).min() > 0


@pytest.mark.parametrize("mesh", CLOSED.values(), ids=CLOSED)
def test_a_closed_mesh_stays_closed_with_its_volume(mesh):
    cut = split_long_edges(mesh, 0.11 * edge_lengths(mesh).max(), 10**6)
    assert as_trimesh(cut).is_watertight
    assert as_trimesh(cut).is_winding_consistent
    assert as_trimesh(cut).volume == pytest.approx(as_trimesh(mesh).volume, rel=1e-12)
    assert as_trimesh(cut).euler_number == as_trimesh(mesh).euler_number


@pytest.mark.parametrize("mesh", OPEN.values(), ids=OPEN)
def test_an_open_surface_gets_no_new_holes(mesh):
    cut = split_long_edges(mesh, 0.11 * edge_lengths(mesh).max(), 10**6)
    assert faces_on_edges(cut.faces) == sorted({*faces_on_edges(mesh.faces), 2})
    assert euler_number(cut) == euler_number(mesh)


@pytest.mark.parametrize("mesh", ALL.values(), ids=ALL)
def test_the_first_vertices_are_the_mesh_own_and_the_rest_lie_on_it(mesh):
    cut = split_long_edges(mesh, 0.2 * edge_lengths(mesh).max(), 10**6)
    assert (cut.vertices[: len(mesh.vertices)] == mesh.vertices).all()
    assert len(np.unique(cut.vertices, axis=0)) == len(cut.vertices)
    _, distance, _ = closest_point_naive(as_trimesh(mesh), cut.vertices)
    assert distance.max() < 1e-9


def test_short_edges_are_left_alone():
    mesh = blob(subdivisions=2)
    assert split_long_edges(mesh, edge_lengths(mesh).max(), 10**6) is mesh


@pytest.mark.parametrize("most", [8, 30, 200])
def test_never_more_vertices_than_allowed(most):
    assert len(split_long_edges(box(3, 2, 1), 1e-6, most).vertices) <= most


def test_of_too_many_long_edges_the_longest_are_split():
    mesh = box(9, 2, 1)
    longest = int((edge_lengths(mesh) > 9 - 1e-9).sum())
    split = split_long_edges(mesh, 1e-6, len(mesh.vertices) + longest)
    assert len(split.vertices) == len(mesh.vertices) + longest
    assert edge_lengths(split).max() < 6
    # Of equally long edges all or none.
    assert split_long_edges(mesh, 1e-6, len(mesh.vertices) + 1) is mesh


@pytest.mark.parametrize("vertices", [100, 2000])
@pytest.mark.parametrize("mesh", CLOSED.values(), ids=CLOSED)
def test_refining_gives_about_the_vertices_asked_for(mesh, vertices):
    assert 0.5 * vertices <= len(refine(mesh, vertices).vertices) <= 8 * vertices


def test_edges_of_an_even_mesh_are_those_of_that_many_vertices():
    # Its vertices lie evenly: asked for as many, it stays; for 16 times as many, it is cut twice.
    ball = icosphere(4)
    assert refine(ball, len(ball.vertices)) is ball
    assert len(refine(ball, 16 * len(ball.vertices)).vertices) == len(icosphere(6).vertices)


def test_edges_as_long_as_each_other_are_cut_alike_however_the_mesh_is_given():
    # Isosceles triangles: which diagonal is the shorter one is a tie wherever two edges are cut.
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 2, 0], [0.5, -2, 0]], [[0, 1, 2], [0, 3, 1]])
    expected = half_edges(split_long_edges(mesh, 1.5, 100).faces).edges
    for seed in range(20):
        found = split_long_edges(turned(faces_shuffled(mesh, seed), seed), 1.5, 100)
        assert half_edges(found.faces).edges.tolist() == expected.tolist()


@pytest.mark.parametrize("turn", range(3))
def test_a_face_with_two_midpoints_is_cut_along_the_shorter_diagonal(turn):
    for corners in np.random.default_rng(turn).normal(size=(20, 3, 3)):
        vertices = np.concatenate([corners, (corners[:2] + corners[1:]) / 2.0])
        face, middle = np.roll([0, 1, 2], turn), np.roll([3, 4, -1], turn)
        pieces = split_faces(face[None], middle[None], vertices)
        edges = half_edges(pieces).edges.tolist()
        lengths = {(a, b): np.linalg.norm(vertices[a] - vertices[b]) for a, b in ((0, 4), (2, 3))}
        assert [list(ends) in edges for ends in lengths] == [
            length == min(lengths.values()) for length in lengths.values()
        ]
        assert len(pieces) == 3
        assert face_areas(vertices, pieces).sum() == pytest.approx(face_areas(vertices, face[None]).sum())
