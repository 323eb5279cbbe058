"""Approximate eigenfunctions beside the exact ones, and the closed form of the sphere."""

import numpy as np
import pytest

from core.dense.subspace_eigenpairs import COARSE, approximate_laplace_beltrami
from core.spectral.laplace_beltrami import laplace_beltrami, laplacian
from tests.core.shapes import icosphere, joined, shifted
from tests.gallery import make_body


@pytest.fixture(scope="module")
def body():
    return make_body("teddy", 1, vertices=2 * COARSE + 200).posed(1)


def test_low_functions_are_nearly_exact_and_all_are_orthonormal(body):
    exact, functions = laplace_beltrami(body, 99)
    values, found = approximate_laplace_beltrami(body, 99)
    assert len(body.vertices) >= 2 * COARSE
    areas = laplacian(body)[1]
    np.testing.assert_allclose(found.T @ (areas[:, None] * found), np.eye(99), atol=1e-6)
    np.testing.assert_allclose(values[:40], exact[:40], rtol=0.002)
    np.testing.assert_allclose(values, exact, rtol=0.05)
    # The span of the first 60 lies within the found functions.
    inside = np.linalg.svd(functions[:, :60].T @ (areas[:, None] * found), compute_uv=False)
    assert inside.min() > 0.99


def test_the_sphere_has_its_eigenvalues():
    sphere = icosphere(4)
    assert len(sphere.vertices) >= 2 * COARSE
    values, _ = approximate_laplace_beltrami(sphere, 48)
    expected = np.concatenate([np.full(2 * degree + 1, degree * (degree + 1.0)) for degree in range(1, 7)])
    np.testing.assert_allclose(values, expected, rtol=0.02)


def test_small_meshes_are_exact():
    sphere = icosphere(2)
    for one, other in zip(
        laplace_beltrami(sphere, 20), approximate_laplace_beltrami(sphere, 20), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_a_shape_of_two_pieces():
    pair = joined(icosphere(3), shifted(icosphere(4), [3.0, 0.0, 0.0]))
    exact, _ = laplace_beltrami(pair, 30)
    values, found = approximate_laplace_beltrami(pair, 30)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(values, exact, rtol=0.02, atol=1e-6)


def test_the_same_mesh_gives_the_same_bytes(body):
    one, other = (approximate_laplace_beltrami(body, 30)[1] for _ in range(2))
    assert one.tobytes() == other.tobytes()
