"""Our intrinsic Delaunay triangulation against robust-laplacian's; covers are closed and oriented."""

import numpy as np
import pytest
import robust_laplacian

from core.mesh.cleaning import clean, face_areas
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.spectral import delaunay as module
from core.spectral.delaunay import MOST_FLIPS, intrinsic_delaunay, mollified_lengths, tufted_cover, twins
from core.spectral.laplace_beltrami import laplacian
from tests.core.shapes import GALLERY, MANY_KINDS, blob, box, icosphere, make_shape, rectangle, scaled, soup


def slivers():
    """A ball pressed and turned, so that about half of its edges are to be flipped, some more than once."""
    ball = icosphere(3)
    angle = 3.0 * ball.vertices[:, 2]
    x, y = ball.vertices[:, 0], ball.vertices[:, 1]
    turned = np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)], axis=1)
    return Mesh(np.c_[turned * [1.0, 0.1], 4.0 * ball.vertices[:, 2]], ball.faces)


CLOSED = {
    **{label: lambda label=label: clean(make_shape(label, 1)).mesh for label in GALLERY[:8]},
    "ball": lambda: icosphere(2),
    "blob": blob,
    "small blob": lambda: scaled(blob(), 1e-3),
    "slivers": slivers,
}


BALL = icosphere(1)
OPEN = {
    "sheet": lambda: rectangle(1.0, 1.0, 4, 4),
    "three sheets on an edge": MANY_KINDS["three sheets on an edge"],
    "one face turned over": lambda: Mesh(BALL.vertices, np.r_[BALL.faces[:1, ::-1], BALL.faces[1:]]),
    "soup": lambda: soup(BALL),
    "slivers with a hole": lambda: Mesh(slivers().vertices, slivers().faces[1:]),
    "slivers and a sheet": lambda: Mesh(slivers().vertices, np.r_[slivers().faces, [[0, 1, 2]]]),
}


def peer(mesh):
    stiffness, mass = robust_laplacian.mesh_laplacian(mesh.vertices, mesh.faces)
    return stiffness, mass.diagonal()


@pytest.mark.parametrize("kind", [*CLOSED, *OPEN])
def test_weights_and_areas_are_robust_laplacians(kind):
    mesh = (CLOSED | OPEN)[kind]()
    stiffness, areas = laplacian(mesh, np.empty((0, 2), dtype=np.int64))
    expected, their_areas = peer(mesh)
    assert abs(stiffness - expected).max() < 1e-6 * abs(expected).max()
    np.testing.assert_allclose(areas, their_areas, rtol=1e-6)


def test_no_weight_is_negative_though_many_were():
    mesh = slivers()
    start, end, weights, _ = intrinsic_delaunay(mesh)
    stiffness = laplacian(mesh)[0].toarray()
    assert stiffness[~np.eye(len(stiffness), dtype=bool)].max() < 1e-5
    before = {frozenset(edge) for edge in half_edges(mesh.faces).edges.tolist()}
    after = {frozenset(edge) for edge in zip(start.tolist(), end.tolist(), strict=True)}
    assert len(after - before) > 100
    assert weights.min() > -1e-5


def fan(count):
    """A sheet of thin triangles around a corner: flips grow with the square of their number."""
    x = np.linspace(0.0, 1.0, count)
    steps = np.arange(1, count - 1)
    return Mesh(np.c_[x, x**2, 0.0 * x], np.stack([0 * steps, steps, steps + 1], axis=1))


def test_the_flips_of_a_fan_are_limited(monkeypatch):
    flips = []
    flip_all = module._flip_all
    monkeypatch.setattr(module, "_flip_all", lambda *given: flips.append((flip_all(*given), given[-1])))
    sheet = fan(1000)
    _, _, weights, areas = intrinsic_delaunay(sheet)
    assert flips == [(MOST_FLIPS * 6 * len(sheet.faces),) * 2]
    assert np.isfinite(weights).all()
    # Longer edges make thin triangles larger.
    assert areas.sum() == pytest.approx(face_areas(sheet.vertices, sheet.faces).sum(), rel=0.05)
    smallest = np.linalg.eigvalsh(laplacian(sheet)[0].toarray())[0]
    assert smallest > -1e-9 * abs(weights).max()


def test_a_cube_needs_no_flip():
    """Its diagonals have weight 0, its edges 1."""
    cube = box(1.0, 1.0, 1.0)
    stiffness, areas = laplacian(cube)
    assert areas.sum() == pytest.approx(face_areas(cube.vertices, cube.faces).sum(), rel=1e-4)
    edges = half_edges(cube.faces).edges
    weights = -np.asarray(stiffness[edges[:, 0], edges[:, 1]]).ravel()
    lengths = np.linalg.norm(cube.vertices[edges[:, 0]] - cube.vertices[edges[:, 1]], axis=1)
    np.testing.assert_allclose(weights[lengths > 1.01 * lengths.min()], 0.0, atol=1e-4)


@pytest.mark.parametrize("kind", OPEN)
def test_other_surfaces_are_left_to_the_cover(kind):
    faces = OPEN[kind]().faces
    assert twins(faces, half_edges(faces)) is None


def test_every_triangle_is_made_longer_than_a_line():
    lengths = np.array([[1.0, 1.0, 2.0], [1.0, 1.0, 1.0]])
    longer = mollified_lengths(lengths)
    assert (longer.sum(axis=1) - 2.0 * longer.max(axis=1)).min() == pytest.approx(
        1e-5 * lengths.mean(), rel=1e-6
    )
    np.testing.assert_array_equal(mollified_lengths(lengths[1:]), lengths[1:])


COVERED = {
    **OPEN,
    "closed": lambda: box(1.0, 2.0, 3.0),
    "three sheets on an edge of length 0": lambda: Mesh(
        [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    ),
}


@pytest.mark.parametrize("kind", COVERED)
def test_every_half_edge_of_the_cover_has_a_twin_that_runs_the_other_way(kind):
    mesh = COVERED[kind]()
    faces, twin = tufted_cover(mesh.vertices, mesh.faces, half_edges(mesh.faces))
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    np.testing.assert_array_equal(twin[twin], np.arange(len(twin)))
    np.testing.assert_array_equal(start[twin], end)
    np.testing.assert_array_equal(np.sort(faces, axis=1), np.sort(np.tile(mesh.faces, (2, 1)), axis=1))


def test_a_closed_surface_is_covered_by_two_sheets():
    mesh = COVERED["closed"]()
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
