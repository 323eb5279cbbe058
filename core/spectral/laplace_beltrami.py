"""Eigenvalues and eigenfunctions of the Laplace-Beltrami operator, the model that section 3.3 names."""

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import LinearOperator, eigsh

from core.arrays import Floats, Ints
from core.graph.bridges import component_bridges
from core.mesh.mesh import Mesh
from core.numerics.symmetric_factor import SymmetricFactor
from core.spectral.delaunay import intrinsic_delaunay

DENSE_BELOW = 200
"""Below this number of vertices the dense eigensolver is faster."""

MORE = 4
"""Number of extra eigenvalues for the iterative solver. It finds the further copies of a repeated eigenvalue
(as of a ball) late, by rounding; without extra ones some of the last would be missed."""


def laplacian(mesh: Mesh, bridges: Ints | None = None) -> tuple[csc_array, Floats]:
    """The cotangent Laplacian of a tufted intrinsic Delaunay cover (Sharp and Crane 2020), and vertex areas.

    The mesh may have holes and non-manifold edges or be a triangle soup. Components are joined by links of
    weight 1 (the edge between two equilateral triangles has 1 / sqrt(3)), so that a shape of several
    components has one spectrum.

    Parameters
    ----------
    mesh : Mesh
        Of n vertices.
    bridges : int64, shape (components - 1, 2), optional
        The links, from `core.graph.bridges.component_bridges`, if known.

    Returns
    -------
    csc_array, shape (n, n)
        Symmetric, positive semidefinite; each row sums to 0.
    float64, shape (n,)
        Area of each vertex, > 0.
    """
    start, end, weights, areas = intrinsic_delaunay(mesh.vertices, mesh.faces)
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


def laplace_beltrami(mesh: Mesh, count: int, bridges: Ints | None = None) -> tuple[Floats, Floats]:
    """The first `count` eigenpairs after the constant one, L phi = lambda M phi.

    Parameters
    ----------
    mesh : Mesh
        Of n vertices.
    count : int
        Less than n.
    bridges : int64, shape (components - 1, 2), optional
        As for `laplacian`.

    Returns
    -------
    float64, shape (count,)
        Eigenvalues, ascending, in units of 1 / length^2.
    float64, shape (n, count)
        Eigenfunctions at the vertices; the sum of area * phi^2 is 1.
    """
    stiffness, areas = laplacian(mesh, bridges)
    root = 1.0 / np.sqrt(areas)
    scaled = csc_array(diags_array(root) @ stiffness @ diags_array(root))
    size = scaled.shape[0]
    if size < max(DENSE_BELOW, 4 * count):
        values, vectors = eigh(scaled.toarray(), subset_by_index=(0, count), check_finite=False)
    else:
        # A small negative shift makes the matrix positive definite.
        # The start vector is fixed, so that the same mesh gives the same bytes.
        shift = -0.01 / float(areas.sum())
        factor = SymmetricFactor(csc_array(scaled - shift * diags_array(np.ones(size))))
        values, vectors = eigsh(
            scaled,
            k=count + 1 + MORE,
            sigma=shift,
            v0=np.sqrt(areas),
            OPinv=LinearOperator(scaled.shape, matvec=factor.solve, dtype=np.float64),
        )
        order = np.argsort(values, kind="stable")[: count + 1]
        values, vectors = values[order], vectors[:, order]
    return np.maximum(values[1:], 0.0), root[:, None] * vectors[:, 1:]
