"""The block Lanczos method against the dense eigensolver, on matrices with repeated eigenvalues."""

import numpy as np
import pytest
from numpy.linalg import LinAlgError
from scipy.linalg import eigh
from scipy.sparse import block_diag, csc_array, diags_array, eye_array, kron

from core.numerics.symmetric_factor import SymmetricFactor
from core.spectral.lanczos import least_eigenpairs


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
    values, vectors = least_eigenpairs(SymmetricFactor(matrix), functions[:, 0], count)
    np.testing.assert_allclose(values, dense[1 : count + 1], rtol=1e-8)
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


def test_the_same_matrix_gives_the_same_bytes():
    factor, known = SymmetricFactor(path(250)), np.full(250, 250**-0.5)
    first, second = (least_eigenpairs(factor, known, 12) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
