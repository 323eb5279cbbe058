"""Log eigenvalues over Weyl's law, and their distance, which another mesh of a surface hardly moves."""

import numpy as np
import pytest
from trimesh import creation

from core.descriptors.eigenvalues import SCALE, WEYL, eigenvalue_distance, log_eigenvalues
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from core.spectral.spectral_embedding import SPECTRUM


def test_eigenvalues_by_weyls_law_are_zeros_and_fewer_go_on_by_it() -> None:
    found = log_eigenvalues(WEYL)
    assert found is not None
    assert found == pytest.approx(np.zeros(SPECTRUM))
    few = log_eigenvalues(np.array([4.0, 8.0]) * np.pi)
    assert few is not None
    assert few == pytest.approx(np.zeros(SPECTRUM))
    assert log_eigenvalues(np.empty(0)) is None


def test_an_error_that_grows_with_the_eigenvalue_is_no_distance() -> None:
    rng = np.random.default_rng(0)
    query = np.log(rng.uniform(0.5, 2.0, SPECTRUM)).astype(np.float16)
    finer = (query.astype(np.float64) + 1e-5 * WEYL).astype(np.float16)
    other = np.log(rng.uniform(0.5, 2.0, SPECTRUM)).astype(np.float16)
    distances = eigenvalue_distance(query, [query, finer, other])
    assert distances[:2] == pytest.approx([0.0, 0.0], abs=2e-3)
    assert distances[2] > 0.1
    assert eigenvalue_distance(other, [query]) == pytest.approx(distances[2:], rel=1e-5)


def test_the_distance_is_a_weighted_mean_of_differences_without_a_trend() -> None:
    step = np.where(np.arange(SPECTRUM) < 2, [1.0] + [-0.5] * (SPECTRUM - 1), 0.0).astype(np.float16)
    found = eigenvalue_distance(step, [np.zeros(SPECTRUM, np.float16)])
    weights = np.arange(1, SPECTRUM + 1.0) ** -0.6
    assert found == pytest.approx([SCALE * (weights[:2] @ [1.0, 0.5]) / weights.sum()], rel=1e-3)


def test_two_meshes_of_a_surface_are_nearer_than_two_surfaces() -> None:
    pipeline = Pipeline()
    coarse, fine, longer = (
        pipeline.embed(ellipsoid(length, level), ["eigenvalues"]).descriptors["eigenvalues"]
        for length, level in ((1.0, 3), (1.0, 4), (1.05, 3))
    )
    mesh, shape = eigenvalue_distance(coarse, [fine, longer])
    assert 4.0 * mesh < shape


def ellipsoid(length: float, level: int) -> Mesh:
    sphere = creation.icosphere(level)
    return Mesh(np.array(sphere.vertices) * [length, 0.7, 0.5], np.array(sphere.faces))
