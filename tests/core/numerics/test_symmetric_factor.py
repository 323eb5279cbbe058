"""Solutions with our factors against SciPy's."""

import numpy as np
import pytest
from scipy.sparse import csc_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from core.numerics.symmetric_factor import SymmetricFactor
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


MATRICES = {
    "Laplacian": shifted_laplacian,
    "arrow": arrow,
    "identity": lambda: csc_array(eye_array(5)),
    "one number": lambda: csc_array(np.array([[4.0]])),
}


@pytest.mark.parametrize("columns", [None, 1, 3, 9])
@pytest.mark.parametrize("kind", MATRICES)
def test_the_solution_is_scipys(kind, columns):
    matrix = MATRICES[kind]()
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
