"""Roughness of known surfaces, and smoothing that takes noise and leaves the form."""

import numpy as np
import pytest
import trimesh

from core.gallery import make_shape
from core.mesh.cleaning import face_areas
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.mesh.preparation import neighbour_means, roughness, taubin_smoothing, vertex_normals
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.sparse_embedding import prepared
from tests.studies.perturbation import add_noise


@pytest.fixture(scope="module")
def ball():
    made = trimesh.creation.icosphere(subdivisions=4)
    return Mesh(made.vertices, made.faces)


def test_neighbours_are_those_that_share_an_edge_each_once(ball):
    means = neighbour_means(half_edges(ball.faces).edges, ball.vertices)
    around = [set() for _ in ball.vertices]
    for face in ball.faces:
        for i in range(3):
            around[face[i]] |= {face[i - 1], face[i - 2]}
    for row, expected in zip(means[:50], around[:50], strict=True):
        np.testing.assert_allclose(row, ball.vertices[sorted(expected)].mean(axis=0), atol=1e-12)


def test_normals_of_a_ball_point_outwards(ball):
    assert np.abs(vertex_normals(ball) - ball.vertices).max() < 0.02


@pytest.mark.parametrize(("label", "pose"), [("hand", 0), ("cup", 1), ("octopus", 2), ("glasses", 3)])
def test_clean_shapes_are_not_rough_and_noisy_ones_are(label, pose):
    mesh = make_shape(label, pose)
    assert roughness(mesh) < 0.06
    edges = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    span = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    assert roughness(add_noise(mesh, 0.5 * edges.mean() / span, 1)) > 0.25


def test_roughness_hangs_on_no_frame(ball):
    noisy = add_noise(ball, 0.02, 3)
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turned = Mesh(noisy.vertices @ rotation * 40.0 + 7.0, noisy.faces)
    assert roughness(turned) == pytest.approx(roughness(noisy), rel=1e-9)


def test_smoothing_takes_the_noise_and_leaves_the_size(ball):
    noisy = add_noise(ball, 0.01, 5)
    smooth = taubin_smoothing(noisy, 10)

    def off(mesh):
        return np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1.0).mean()

    assert off(smooth) < 0.4 * off(noisy)
    whole = face_areas(ball.vertices, ball.faces).sum()
    assert face_areas(noisy.vertices, noisy.faces).sum() > 1.2 * whole
    assert face_areas(smooth.vertices, smooth.faces).sum() == pytest.approx(whole, rel=0.02)
    assert np.linalg.norm(smooth.vertices, axis=1).mean() == pytest.approx(1.0, abs=0.01)


def test_a_clean_mesh_is_embedded_as_it_is_and_a_noisy_one_smoothed():
    pipeline = Pipeline(DEFAULT)
    mesh = make_shape("hand", 0)
    normal, _, frame, _ = prepared(mesh, pipeline.parameters)
    assert np.isin(np.round(frame.apply(mesh.vertices), 9), np.round(normal.vertices, 9)).all()
    noisy = add_noise(mesh, 0.01, 1)
    assert roughness(prepared(noisy, pipeline.parameters)[0]) < DEFAULT.mesh.smooth_above < roughness(noisy)
