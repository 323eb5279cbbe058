"""Eigenvalues and eigenfunctions of the Laplace-Beltrami operator, the model that section 3.3 names."""

import numpy as np
import robust_laplacian
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from core.arrays import Floats, Ints
from core.graph.bridges import component_bridges
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from core.spectral.delaunay import intrinsic_delaunay

DENSE_BELOW = 200
"""Below this number of vertices the dense eigensolver is faster."""

MORE = 4
"""Number of extra eigenvalues for the iterative solver. It finds the further copies of a repeated eigenvalue
(as of a ball) late, by rounding; without extra ones some of the last would be missed."""


def tufted(mesh: Mesh) -> tuple[csc_array, Floats]:
    """The cotangent Laplacian of the tufted cover, shape (n, n), and vertex areas, by robust-laplacian."""
    stiffness, mass = robust_laplacian.mesh_laplacian(
        np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.faces)
    )
    return csc_array(stiffness), np.asarray(mass.diagonal())


def _closed(mesh: Mesh) -> tuple[csc_array, Floats] | None:
    """The Laplacian and vertex areas of a closed, oriented mesh, which need no cover; None of any other."""
    found = intrinsic_delaunay(mesh.vertices, mesh.faces, half_edges(mesh.faces))
    if found is None:
        return None
    start, end, weights, areas = found
    count = len(areas)
    around = np.bincount(start, weights, count) + np.bincount(end, weights, count)
    here = np.arange(count)
    rows, columns = np.concatenate([start, end, here]), np.concatenate([end, start, here])
    stiffness = coo_array(
        (np.concatenate([-weights, -weights, around]), (rows, columns)), shape=(count, count)
    )
    return csc_array(stiffness), areas


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
    stiffness, areas = _closed(mesh) or tufted(mesh)
    areas = np.maximum(areas, 1e-9 * areas.mean())
    pairs = component_bridges(mesh) if bridges is None else bridges
    if len(pairs):
        rows = np.concatenate([pairs[:, 0], pairs[:, 1], pairs[:, 0], pairs[:, 1]])
        columns = np.concatenate([pairs[:, 1], pairs[:, 0], pairs[:, 0], pairs[:, 1]])
        values = np.repeat([-1.0, -1.0, 1.0, 1.0], len(pairs))
        links = csc_array((values, (rows, columns)), shape=stiffness.shape)
        stiffness = stiffness + links
    return csc_array(stiffness), areas


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
        # A small negative shift makes the matrix positive definite, so the factorisation needs no pivoting.
        # The start vector is fixed, so that the same mesh gives the same bytes.
        shift = -0.01 / float(areas.sum())
        factor = splu(
            csc_array(scaled - shift * diags_array(np.ones(size))),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
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
