"""Eigenvalues and eigenfunctions of the Laplace-Beltrami operator, the model that section 3.3 names."""

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import LinearOperator, eigsh

from core.arrays import Floats, Ints
from core.graph.bridges import component_bridges
from core.mesh.mesh import Mesh
from core.spectral.delaunay import intrinsic_delaunay
from core.spectral.lanczos import CONVERGED, SymmetricFactor, least_eigenpairs

DENSE_BELOW = 200
"""Below this number of vertices the dense eigensolver is faster."""

DENSE_UP_TO = 3000
"""Up to this number of vertices the dense solver takes over if the Lanczos method does not converge, above it
ARPACK: equal eigenvalues of a small matrix leave no room, nor do more than a hundred nearly equal ones, as of
a flower or a brush."""

MORE = 4
"""Number of extra eigenvalues that ARPACK computes: it may find a further copy of an eigenvalue late."""

SHIFT = 100.0
"""Number that is added to the eigenvalues, times the area: it makes the matrix positive definite. The first
eigenvalue of a sphere is 25 / area, the thirtieth about 380. If all eigenvalues are shifted by far less, the
first ones of the inverse are far above the others, and Lanczos vectors lose their orthogonality to those
functions in every step; by far more, and all are alike."""


def laplacian(mesh: Mesh, bridges: Ints | None = None) -> tuple[csc_array, Floats]:
    """Return the cotangent Laplacian of a tufted cover (Sharp and Crane 2020), and vertex areas.

    The mesh may have holes and non-manifold edges or be a triangle soup. Components are joined by links of
    weight 1 (the edge between two equilateral triangles has 1 / sqrt(3)), so that a shape of several
    components has one spectrum. `bridges`, shape (components - 1, 2), are the links, if they are known, from
    `core.graph.bridges.component_bridges`.

    The matrix, shape (n, n), is symmetric and positive semidefinite, and each row sums to 0; areas, shape
    (n,), are > 0.
    """
    start, end, weights, areas = intrinsic_delaunay(mesh)
    pairs = component_bridges(mesh) if bridges is None else bridges
    start, end = np.concatenate([start, pairs[:, 0]]), np.concatenate([end, pairs[:, 1]])
    weights = np.concatenate([weights, np.ones(len(pairs))])
    count = len(areas)
    around = np.bincount(start, weights, count) + np.bincount(end, weights, count)
    here = np.arange(count)
    rows, columns = np.concatenate([start, end, here]), np.concatenate([end, start, here])
    values = np.concatenate([-weights, -weights, around])
    stiffness = coo_array((values, (rows, columns)), shape=(count, count))
    return csc_array(stiffness), np.maximum(areas, 1e-9 * areas.mean())


def laplace_beltrami(mesh: Mesh, count: int) -> tuple[Floats, Floats]:
    """Return the first `count` eigenpairs after the constant one, as `laplace_beltrami_spectrum` does."""
    return laplace_beltrami_spectrum(mesh, count, 0)[:2]


def laplace_beltrami_spectrum(
    mesh: Mesh, count: int, more: int, bridges: Ints | None = None
) -> tuple[Floats, Floats, Floats]:
    """Return the first `count` eigenpairs after the constant one, L phi = lambda M phi, and more eigenvalues.

    Eigenvalues, shape (count,), count < n, ascend, in units of 1 / length^2. Eigenfunctions are at the
    vertices, shape (n, count); the sum of area * phi^2 is 1. The third array has the first `more`
    eigenvalues, ascending, with a relative error of about 2e-3; there are fewer if n is too small, or if more
    than a hundred are nearly equal. `bridges` are those of `laplacian`.
    """
    stiffness, areas = laplacian(mesh, bridges)
    if len(areas) < max(DENSE_BELOW, 4 * count):
        values, vectors, spectrum = _dense(stiffness, areas, count, more)
    else:
        values, vectors, spectrum = _sparse(stiffness, areas, count, more)
    return np.maximum(values, 0.0), vectors / np.sqrt(areas)[:, None], np.maximum(spectrum, 0.0)


def scaled(stiffness: csc_array, areas: Floats, shift: float = 0.0) -> csc_array:
    """Return the symmetric matrix M^-1/2 L M^-1/2 + shift, whose eigenvectors are M^1/2 phi.

    L and the diagonal of M are those of `laplacian`; the shift is added to the eigenvalues.
    """
    root = 1.0 / np.sqrt(areas)
    rows, columns = stiffness.indices, np.repeat(np.arange(len(areas)), np.diff(stiffness.indptr))
    values = stiffness.data * (root[rows] * root[columns])
    values[rows == columns] += shift
    return csc_array((values, rows, stiffness.indptr), shape=stiffness.shape)


def _dense(stiffness: csc_array, areas: Floats, count: int, more: int) -> tuple[Floats, Floats, Floats]:
    """Return eigenpairs of the scaled matrix, without the constant function, and more eigenvalues."""
    matrix = scaled(stiffness, areas).toarray()
    last = min(max(count, more), len(areas) - 1)
    values, vectors = eigh(matrix, subset_by_index=(0, last), check_finite=False)
    return values[1 : count + 1], vectors[:, 1 : count + 1], values[1 : more + 1]


def _sparse(stiffness: csc_array, areas: Floats, count: int, more: int) -> tuple[Floats, Floats, Floats]:
    """Return what `_dense` returns, by `core.spectral.lanczos`, or by ARPACK where this does not converge."""
    area = float(areas.sum())
    factor = SymmetricFactor(scaled(stiffness, areas, SHIFT / area))
    try:
        values, vectors, spectrum = least_eigenpairs(factor, np.sqrt(areas / area), count, more)
    except LinAlgError:
        if len(areas) <= DENSE_UP_TO:
            return _dense(stiffness, areas, count, more)
        values, vectors = _with_restarts(factor, len(areas), count)
        spectrum = values[:more]
    return values - SHIFT / area, vectors, spectrum - SHIFT / area


def _with_restarts(factor: SymmetricFactor, size: int, count: int) -> tuple[Floats, Floats]:
    """Return the least eigenpairs of a factored matrix after the first, by ARPACK from a fixed vector.

    To the last bit, ARPACK would separate eigenvalues that are equal but for rounding, as the pages of a book
    have by the thousand.
    """
    inverse = LinearOperator((size, size), matvec=factor.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(size)
    values, vectors = eigsh(inverse, k=count + 1 + MORE, which="LM", v0=start, tol=CONVERGED)
    order = np.argsort(-values, kind="stable")[1 : count + 1]
    return 1.0 / values[order], vectors[:, order]
