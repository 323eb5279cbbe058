"""Solutions with the factors against SciPy's, and eigenpairs against the dense solver's."""

import numpy as np
import pytest
from numpy.linalg import LinAlgError
from scipy.linalg import eigh
from scipy.sparse import block_diag, csc_array, diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve

from core.spectral.lanczos import SymmetricFactor, least_eigenpairs
from core.spectral.laplace_beltrami import laplacian
from tests.core.shapes import blob


def shifted_laplacian():
    stiffness, areas = laplacian(blob())
    return csc_array(stiffness + 0.01 * diags_array(areas))


def arrow():
    """Its first column, of 40 entries, is the last to be eliminated."""
    matrix = 40.0 * np.eye(40)
    matrix[0, 1:] = matrix[1:, 0] = 1.0
    return csc_array(matrix)


FACTORED = {
    "Laplacian": shifted_laplacian,
    "arrow": arrow,
    "one number": lambda: csc_array(np.array([[4.0]])),
}


@pytest.mark.parametrize("columns", [None, 3])
@pytest.mark.parametrize("kind", FACTORED)
def test_the_solution_is_scipys(kind, columns):
    matrix = FACTORED[kind]()
    size = matrix.shape[0]
    right = np.random.default_rng(0).standard_normal(size if columns is None else (size, columns))
    expected = spsolve(matrix, right).reshape(right.shape)
    found = SymmetricFactor(matrix).solve(right)
    assert found.shape == right.shape
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


INDEFINITE = {"zeros": np.zeros((3, 3)), "exchange": np.eye(2)[::-1], "negative": -np.eye(3)}


@pytest.mark.parametrize("kind", INDEFINITE)
def test_a_matrix_that_is_not_positive_definite_is_refused(kind):
    with pytest.raises(RuntimeError, match="not positive definite"):
        SymmetricFactor(csc_array(INDEFINITE[kind]))


def test_a_right_side_of_another_length_is_refused():
    with pytest.raises(ValueError, match="4 rows for a matrix of 5"):
        SymmetricFactor(csc_array(eye_array(5))).solve(np.ones(4))


def path(size):
    """The Laplacian of a path, plus 0.01: its eigenvalues are simple, and that of the constant is 0.01."""
    degrees = np.full(size, 2.0)
    degrees[[0, -1]] = 1.0
    edges = -np.ones(size - 1)
    return csc_array(diags_array([edges, degrees + 0.01, edges], offsets=[-1, 0, 1]))


def copies_of_a_path(copies):
    return csc_array(kron(eye_array(copies), path(400 // copies)))


MATRICES = {
    "simple eigenvalues": lambda: path(300),
    "pairs and simple eigenvalues": lambda: csc_array(block_diag([path(150), path(150), path(90)])),
    "4 copies": lambda: copies_of_a_path(4),
    "11 copies": lambda: copies_of_a_path(11),
    "a factor of 1e8 between the first eigenvalues": lambda: csc_array(
        block_diag([1e-6 * path(200), 100.0 * path(200)])
    ),
}


@pytest.mark.parametrize("count", [1, 7, 30])
@pytest.mark.parametrize("kind", MATRICES)
def test_the_eigenpairs_are_those_of_the_dense_solver(kind, count):
    matrix = MATRICES[kind]()
    dense, functions = eigh(matrix.toarray())
    values, vectors, more = least_eigenpairs(SymmetricFactor(matrix), functions[:, 0], count, 40)
    np.testing.assert_allclose(values, dense[1 : count + 1], rtol=1e-8)
    if count == 30:  # otherwise eleven copies of a later value go unnoticed
        np.testing.assert_allclose(more[:30], dense[1:31], rtol=1e-3)
        np.testing.assert_allclose(more, dense[1:41], rtol=0.05)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(count), atol=1e-8)
    np.testing.assert_allclose(functions[:, 0] @ vectors, 0.0, atol=1e-8)
    # The tolerance is relative to the eigenvalue of the inverse.
    solved = SymmetricFactor(matrix).solve(vectors) * values
    np.testing.assert_allclose(solved, vectors, atol=1e-8)


def test_more_copies_than_the_matrix_leaves_room_for_are_refused():
    matrix = csc_array(kron(eye_array(60), path(4)))
    known = eigh(matrix.toarray(), subset_by_index=(0, 0))[1][:, 0]
    with pytest.raises(LinAlgError, match="do not converge"):
        least_eigenpairs(SymmetricFactor(matrix), known, 50)


@pytest.mark.parametrize("copies", [31, 100])
def test_every_copy_is_found_of_many_equal_parts(copies):
    """A block of 4 vectors finds 4 of them."""
    matrix = csc_array(kron(eye_array(copies), path(40)))
    known = np.repeat([40**-0.5, 0.0], [40, 40 * (copies - 1)])
    values, vectors, more = least_eigenpairs(SymmetricFactor(matrix), known, 30)
    assert not more.size
    np.testing.assert_allclose(values, 0.01, rtol=1e-10)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(30), atol=1e-10)
