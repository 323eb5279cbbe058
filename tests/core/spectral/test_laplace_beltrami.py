"""The Laplace-Beltrami operator against spectra known in closed form."""

import numpy as np
import pytest
from scipy.linalg import eigh

from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.spectral import laplace_beltrami as module
from core.spectral.laplace_beltrami import laplace_beltrami, laplacian
from tests.core.shapes import (
    MANY_KINDS,
    SAME_SHAPE,
    blob,
    icosphere,
    joined,
    rectangle,
    scaled,
    shifted,
    soup,
    turned,
)

NAMED = ["loose parts", "box", "sheet", "three sheets on an edge", "two blobs"]
KINDS = {**{name: MANY_KINDS[name] for name in NAMED}, "soup": lambda: soup(blob(0, 1))}


def test_the_unit_sphere():
    """l (l + 1), each 2 l + 1 times."""
    values, _ = laplace_beltrami(icosphere(3), 15)
    np.testing.assert_allclose(values, [2.0] * 3 + [6.0] * 5 + [12.0] * 7, rtol=0.03)


def test_the_spheres_first_functions_are_the_coordinates():
    ball = icosphere(3)
    _, functions = laplace_beltrami(ball, 3)
    weight = laplacian(ball)[1][:, None]
    coordinates = ball.vertices / np.sqrt((weight * ball.vertices**2).sum(axis=0))
    overlap = functions.T @ (weight * coordinates)
    np.testing.assert_allclose(overlap @ overlap.T, np.eye(3), atol=0.01)


@pytest.mark.parametrize(("width", "height"), [(1.0, 1.0), (3.0, 2.0)])
def test_a_rectangle_with_free_edges(width, height):
    """pi^2 (m^2 / a^2 + n^2 / b^2), Neumann's condition."""
    values, _ = laplace_beltrami(rectangle(width, height, 36, 24), 10)
    m, n = np.meshgrid(np.arange(8), np.arange(8))
    expected = np.sort((np.pi**2 * (m**2 / width**2 + n**2 / height**2)).ravel())[1:11]
    np.testing.assert_allclose(values, expected, rtol=0.03)


@pytest.mark.parametrize("factor", [0.01, 3.0, 250.0])
def test_eigenvalues_go_with_one_over_length_squared(factor):
    values, functions = laplace_beltrami(blob(), 8)
    larger, flatter = laplace_beltrami(scaled(blob(), factor), 8)
    np.testing.assert_allclose(larger, values / factor**2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(flatter), np.abs(functions) / factor, atol=1e-5 / factor)


@pytest.mark.parametrize("kind", KINDS)
def test_functions_are_orthonormal_by_area(kind):
    mesh = KINDS[kind]()
    stiffness, areas = laplacian(mesh)
    count = min(8, len(areas) - 2)
    values, functions = laplace_beltrami(mesh, count)
    assert values.shape == (count,)
    assert functions.shape == (len(areas), count)
    assert (np.diff(values) >= 0.0).all()
    np.testing.assert_allclose(functions.T @ (areas[:, None] * functions), np.eye(count), atol=1e-6)
    np.testing.assert_allclose(areas @ functions, 0.0, atol=1e-6 * np.sqrt(areas.sum()))
    residual = stiffness @ functions - areas[:, None] * functions * values
    assert np.abs(residual).max() < 1e-6 * np.abs(stiffness.diagonal()).max() * np.abs(functions).max()


@pytest.mark.parametrize("kind", KINDS)
def test_the_stiffness_is_symmetric_and_takes_constants_to_nought(kind):
    mesh = KINDS[kind]()
    stiffness, areas = laplacian(mesh)
    size = np.abs(stiffness.diagonal()).max()
    assert abs(stiffness - stiffness.T).max() < 1e-9 * size
    np.testing.assert_allclose(stiffness @ np.ones(len(areas)), 0.0, atol=1e-9 * size)
    smallest = eigh(stiffness.toarray(), eigvals_only=True, subset_by_index=(0, 1))
    assert abs(smallest[0]) < 1e-9 * size
    assert smallest[1] > 1e-9 * size
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(face_areas(mesh.vertices, mesh.faces).sum(), rel=1e-3)


def test_two_loose_spheres_have_only_the_constant_at_nought():
    """One link joins them: one small eigenvalue more than a sphere has, whose function tells them apart."""
    pair = joined(icosphere(2), shifted(icosphere(2), (3.0, 0.0, 0.0)))
    values, functions = laplace_beltrami(pair, 7)
    half = len(pair.vertices) // 2
    assert 1e-3 < values[0] < 0.5 * values[1]
    means = functions[:half, 0].mean(), functions[half:, 0].mean()
    assert means[0] * means[1] < 0.0
    # Both spheres' triples at 2: the link disturbs only the pair that is not nought where it is tied.
    np.testing.assert_allclose(values[1:5], 2.0, rtol=0.05)


@pytest.mark.parametrize("kind", ["sheet", "two blobs", "loose parts"])
def test_the_dense_and_the_sparse_solver_agree(kind, monkeypatch):
    mesh = KINDS[kind]()
    found = []
    for limit in (0, 10**6):
        monkeypatch.setattr(module, "DENSE_BELOW", limit)
        found.append(laplace_beltrami(mesh, 6))
    (sparse, some), (dense, others) = found
    np.testing.assert_allclose(sparse, dense, rtol=1e-6)
    if kind != "loose parts":
        overlap = some.T @ (laplacian(mesh)[1][:, None] * others)
        np.testing.assert_allclose(np.abs(overlap), np.eye(6), atol=1e-5)


@pytest.mark.parametrize("change", [None, *SAME_SHAPE])
def test_no_multiple_eigenvalue_is_missed(change):
    """Two balls, linked, have each ball's seven and nine times; an eigensolver may end before the last."""
    pair = joined(shifted(icosphere(3), (2.0, 0.0, 0.0)), shifted(icosphere(3), (-2.0, 0.0, 0.0)))
    pair = clean(pair if change is None else SAME_SHAPE[change](pair)).mesh
    stiffness, areas = laplacian(pair)
    dense = eigh(stiffness.toarray(), np.diag(areas), eigvals_only=True, subset_by_index=(1, 30))
    np.testing.assert_allclose(laplace_beltrami(pair, 30)[0], dense, rtol=1e-6)


def test_a_flower_of_many_nearly_equal_petals_is_solved_with_restarts(monkeypatch):
    """More nearly equal eigenvalues than the Lanczos method without restarts has room for."""
    petals = 300
    rng = np.random.default_rng(0)
    angles = 2.0 * np.pi * np.arange(petals) / petals
    rims = [np.stack([np.cos(turn), np.sin(turn)], axis=1) for turn in (angles, angles + 0.3 / petals)]
    length = 1.0 + 0.05 * rng.standard_normal((petals, 1))
    corners = np.concatenate([np.zeros((1, 2)), length * rims[0], length * rims[1]])
    here = np.arange(petals)
    flower = Mesh(
        np.pad(corners, ((0, 0), (0, 1))),
        np.stack([np.zeros(petals, dtype=int), 1 + here, 1 + petals + here], axis=1),
    )
    stiffness, areas = laplacian(flower)
    expected = eigh(stiffness.toarray(), np.diag(areas), subset_by_index=(1, 30), eigvals_only=True)
    monkeypatch.setattr(module, "DENSE_UP_TO", 0)
    values, functions = laplace_beltrami(flower, 30)
    assert values == pytest.approx(expected, rel=1e-6)
    residual = stiffness @ functions - areas[:, None] * functions * values
    assert np.abs(residual).max() < 1e-4 * np.abs(stiffness @ functions).max()


def test_the_pages_of_a_book_are_not_separated_to_the_last_bit(monkeypatch):
    """Triangles around one edge have one eigenvalue, but for rounding."""
    pages = 1000
    angles = 2.0 * np.pi * np.arange(pages) / pages
    rim = np.stack([np.cos(angles), np.sin(angles), 0.5 + 0.3 * np.sin(3.0 * angles)], axis=1)
    here = np.arange(pages)
    faces = np.stack([0 * here, 0 * here + 1, 2 + here], axis=1)
    book = turned(Mesh(np.concatenate([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], rim]), faces), 2)
    stiffness, areas = laplacian(book)
    expected = eigh(stiffness.toarray(), np.diag(areas), subset_by_index=(1, 30), eigvals_only=True)
    assert np.ptp(expected[1:]) < 1e-9 * expected[1]
    monkeypatch.setattr(module, "DENSE_UP_TO", 0)
    solutions, solve = [], module.SymmetricFactor.solve
    monkeypatch.setattr(
        module.SymmetricFactor, "solve", lambda factor, right: solutions.append(1) or solve(factor, right)
    )
    assert laplace_beltrami(book, 30)[0] == pytest.approx(expected, rel=1e-9)
    assert len(solutions) < pages / 2
