"""The steps of preparation: closed holes, smoothed noise, nearest vertices."""

import numpy as np
import pytest

from core.evaluation.perturbation import remove_discs
from core.mesh import preparation as module
from core.mesh.cleaning import clean
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.mesh.preparation import (
    fill_holes,
    nearest_vertices,
    neighbour_means,
    roughness,
    taubin_smoothing,
    vertex_normals,
)
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.shortlist import spectral_distances
from core.sparse_embedding import prepared
from tests.core.shapes import area, icosphere, joined, rectangle, turned
from tests.gallery import make_shape
from tests.studies.machine_parts import Drawing, part
from tests.studies.perturbation import add_noise, make_soup


def without_caps(mesh: Mesh, heights: list[float]) -> Mesh:
    """A unit sphere without the faces below the first height, and above the second."""
    z = mesh.vertices[mesh.faces][:, :, 2].mean(axis=1)
    return clean(Mesh(mesh.vertices, mesh.faces[(z > heights[0]) & (z < heights[1])])).mesh


def open_edges(mesh: Mesh) -> int:
    return int((half_edges(mesh.faces).face_counts == 1).sum())


BALL, FINE = icosphere(3), icosphere(4)


def test_a_closed_mesh_stays_the_same_object():
    assert fill_holes(BALL, 10.0) is BALL


def test_each_rim_gets_a_vertex_in_its_middle():
    ring = without_caps(BALL, [-0.8, 0.7])
    found = fill_holes(ring, 1.0)
    assert np.array_equal(found.vertices[: len(ring.vertices)], ring.vertices)
    assert np.array_equal(found.faces[: len(ring.faces)], ring.faces)
    new = found.vertices[len(ring.vertices) :]
    assert len(new) == 2
    assert np.abs(new[:, :2]).max() < 0.02
    assert sorted(np.round(new[:, 2], 1)) == [-0.8, 0.7]
    assert len(found.faces) == len(ring.faces) + open_edges(ring)


def test_the_faces_run_as_their_neighbours_do_and_leave_nothing_open():
    found = fill_holes(without_caps(BALL, [-0.8, 0.7]), 1.0)
    sides = half_edges(found.faces)
    assert set(sides.face_counts) == {2}
    start = found.faces.ravel()[sides.order].reshape(-1, 2)
    assert np.array_equal(np.sort(start, axis=1), sides.edges)


@pytest.mark.parametrize(("most", "count"), [(0.03, 0), (0.2, 1), (0.6, 2)])
def test_only_rims_that_bound_little_are_closed(most, count):
    """Round ones would bound 0.07 and 0.27 of the surface; these zigzag, up to 1.3 times as long."""
    ring = without_caps(BALL, [-0.9, 0.5])
    shares = [np.pi * (1.0 - height**2) / area(ring) for height in (0.9, 0.5)]
    assert np.allclose(shares, (0.07, 0.27), atol=0.01)
    assert len(fill_holes(ring, most).vertices) - len(ring.vertices) == count


def test_sheets_and_triangles_by_themselves_are_no_holes():
    soup = make_soup(BALL, 0.2, 0)
    assert fill_holes(soup, DEFAULT.mesh.fill_holes) is soup
    sheet = rectangle(2.0, 1.0, 12, 6)
    assert fill_holes(sheet, DEFAULT.mesh.fill_holes) is sheet


def test_each_part_is_measured_by_its_own_area():
    ring = without_caps(BALL, [-0.95, 2.0])
    small = Mesh(0.02 * ring.vertices + [3.0, 0.0, 0.0], ring.faces)
    both = joined(rectangle(2.0, 1.0, 12, 6), small)
    found = fill_holes(both, DEFAULT.mesh.fill_holes)
    assert len(found.vertices) == len(both.vertices) + 1
    assert np.linalg.norm(found.vertices[-1] - [3.0, 0.0, -0.019]) < 0.002


def test_rims_that_meet_are_left_open():
    """Two faces gone that share one vertex, and elsewhere one face, which is closed."""
    here = np.flatnonzero((BALL.faces == 0).any(axis=1))
    shared = [len(np.intersect1d(BALL.faces[here[0]], BALL.faces[face])) for face in here]
    opposite = int(np.argmin(BALL.vertices[BALL.faces].mean(axis=1) @ BALL.vertices[0]))
    drop = {int(here[0]), int(here[np.argmin(shared)]), opposite}
    kept = [face for face in range(len(BALL.faces)) if face not in drop]
    mesh = Mesh(BALL.vertices, BALL.faces[kept])
    found = fill_holes(mesh, 1.0)
    assert len(found.vertices) == len(mesh.vertices) + 1
    assert open_edges(found) == 6


def test_more_vertices_on_one_side_do_not_move_the_middle():
    square = np.array([(0, 0, 0), (0.25, 0, 0), (0.5, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, -9)])
    rim = np.arange(6)
    cone = Mesh(square.astype(float), np.stack([rim, np.roll(rim, -1), np.full(6, 6)], axis=1))
    assert np.allclose(fill_holes(cone, 1.0).vertices[-1], (0.5, 0.5, 0.0))


def test_a_shape_with_holes_is_more_like_the_whole_one_once_they_are_closed():
    shape = make_shape("quadruped", 1)
    holed = remove_discs(turned(Mesh(shape.vertices, shape.faces), 3), 0.15, 1)
    found = []
    for parameters in (DEFAULT, DEFAULT.with_values(mesh={"fill_holes": 0.0})):
        method = Pipeline(parameters)
        found.append(method.score(method.embed(shape), [method.embed(holed)]).cc[0])
    assert found[0] > found[1]


def test_neighbours_are_those_that_share_an_edge_each_once():
    means = neighbour_means(half_edges(FINE.faces).edges, FINE.vertices)
    around = [set() for _ in FINE.vertices]
    for face in FINE.faces:
        for i in range(3):
            around[face[i]] |= {face[i - 1], face[i - 2]}
    for row, expected in zip(means[:50], around[:50], strict=True):
        np.testing.assert_allclose(row, FINE.vertices[sorted(expected)].mean(axis=0), atol=1e-12)


def test_normals_of_a_ball_point_outwards():
    assert np.abs(vertex_normals(FINE) - FINE.vertices).max() < 0.02


@pytest.mark.parametrize(("label", "pose"), [("hand", 0), ("cup", 1), ("octopus", 2), ("glasses", 3)])
def test_clean_shapes_are_not_rough_and_noisy_ones_are(label, pose):
    mesh = make_shape(label, pose)
    assert roughness(mesh) < 0.06
    edges = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    span = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    assert roughness(add_noise(mesh, 0.5 * edges.mean() / span, 1)) > 0.25


def test_roughness_hangs_on_no_frame():
    noisy = add_noise(FINE, 0.02, 3)
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turned = Mesh(noisy.vertices @ rotation * 40.0 + 7.0, noisy.faces)
    assert roughness(turned) == pytest.approx(roughness(noisy), rel=1e-9)


def test_smoothing_takes_the_noise_and_leaves_the_size():
    noisy = add_noise(FINE, 0.01, 5)
    smooth = taubin_smoothing(noisy, 10)

    def off(mesh):
        return np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1.0).mean()

    assert off(smooth) < 0.4 * off(noisy)
    assert area(noisy) > 1.2 * area(FINE)
    assert area(smooth) == pytest.approx(area(FINE), rel=0.02)
    assert np.linalg.norm(smooth.vertices, axis=1).mean() == pytest.approx(1.0, abs=0.01)


def test_a_clean_mesh_is_embedded_as_it_is_and_a_noisy_one_smoothed():
    pipeline = Pipeline(DEFAULT)
    mesh = make_shape("hand", 0)
    normal, _, frame, _ = prepared(mesh, pipeline.parameters)
    assert np.isin(np.round(frame.apply(mesh.vertices), 9), np.round(normal.vertices, 9)).all()
    noisy = add_noise(mesh, 0.01, 1)
    assert roughness(prepared(noisy, pipeline.parameters)[0]) < DEFAULT.mesh.smooth_above < roughness(noisy)


@pytest.mark.parametrize(("family", "number"), [("grid", 273), ("housing", 5)])
def test_a_part_has_its_spectrum_at_any_chord_tolerance(family, number):
    """The long slivers between circles of many vertices are split, and are no noise."""
    pipeline = Pipeline(DEFAULT)
    coarse, fine = (part(family, Drawing(number, tolerance)) for tolerance in (0.1, 0.002))
    assert not prepared(fine, DEFAULT).smoothed
    signatures = [pipeline.embed(mesh).signature for mesh in (coarse, fine)]
    # 0.3 and more where slivers stay, and 1.2 where such a mesh is smoothed.
    assert spectral_distances(signatures[0], signatures[1][None])[0] < 0.03


@pytest.mark.parametrize("most", [0, 10_000])
def test_nearest_vertices_are_those_of_least_distance(most, monkeypatch):
    monkeypatch.setattr(module, "MOST_IN_TREE", most)
    rng = np.random.default_rng(0)
    vertices, points = rng.normal(size=(3000, 3)), rng.normal(size=(70, 3))
    expected = np.linalg.norm(points[:, None] - vertices, axis=2).argmin(axis=1)
    assert nearest_vertices(vertices, points).tolist() == expected.tolist()


def test_the_first_of_coincident_vertices_is_taken_in_a_large_mesh(monkeypatch):
    monkeypatch.setattr(module, "MOST_IN_TREE", 0)
    points = np.random.default_rng(1).normal(size=(40, 3))
    assert nearest_vertices(np.tile(points, (3, 1)), points).tolist() == list(range(40))
