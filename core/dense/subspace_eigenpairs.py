"""Approximate eigenfunctions of the Laplace-Beltrami operator, in a third of the time of exact ones.

A coarse space of smooth bumps around some hundred vertices gives a first subspace (Galerkin, as in
A. Nasikun, C. Brandt and K. Hildebrandt, "Fast approximation of Laplace-Beltrami eigenproblems", 2018), and a
few steps of inverse iteration with Rayleigh-Ritz projection refine it. The low functions are exact to some
digits; the last ones, which ZoomOut reads least, are mixed with their neighbours.
"""

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import csc_array, csr_array, diags_array

from core.arrays import Floats
from core.mesh.mesh import Mesh
from core.spectral.lanczos import SymmetricFactor
from core.spectral.laplace_beltrami import laplace_beltrami, laplacian, scaled

COARSE, GUARD, SPREAD = 500, 30, 3
"""Least number of bumps of the coarse space, functions that are computed beyond those asked for, and steps of
diffusion that widen a bump."""

BUMPS_EACH = 3
"""Bumps for each function that is asked for."""

_SETTLED = 1e-7
"""Least norm of the change of a function in the second step: below it the function is exact."""

_REGULAR = 1e-10
"""Added to the mass of the bumps, relative to its mean: two bumps may nearly coincide."""


def approximate_laplace_beltrami(mesh: Mesh, count: int) -> tuple[Floats, Floats]:
    """Return the first `count` eigenpairs after the constant one, approximately on large meshes.

    Parameters and result are those of `core.spectral.laplace_beltrami.laplace_beltrami`. Meshes with less
    than two vertices for each bump, and the few whose coarse space is degenerate, get exact eigenpairs.
    """
    coarse = max(COARSE, BUMPS_EACH * count)
    if len(mesh.vertices) < 2 * coarse:
        return laplace_beltrami(mesh, count)
    stiffness, areas = laplacian(mesh)
    try:
        values, functions = _by_subspace(stiffness, areas, count + 1, coarse)
    except LinAlgError:
        return laplace_beltrami(mesh, count)
    return np.maximum(values[1:], 0.0), functions[:, 1:]


def _by_subspace(stiffness: csc_array, areas: Floats, count: int, coarse: int) -> tuple[Floats, Floats]:
    """Compute eigenpairs, the constant one first; the functions have unit norm by area."""
    root = np.sqrt(areas)
    matrix = scaled(stiffness, areas)
    # A small shift makes the matrix positive definite.
    shift = 0.01 / float(areas.sum())
    factor = SymmetricFactor(scaled(stiffness, areas, shift))
    bumps = csr_array(diags_array(root) @ _bumps(stiffness, areas, coarse))
    mass = (bumps.T @ bumps).toarray()
    mass += _REGULAR * float(np.trace(mass)) / coarse * np.eye(coarse)
    energy = (bumps.T @ matrix @ bumps).toarray()
    # All pairs by divide and conquer take less time than some of them.
    values, mixed = (each[..., : count + GUARD] for each in eigh(energy, mass, check_finite=False))
    values, vectors = _ritz(matrix, factor.solve(np.asarray(bumps @ mixed)) * (values + shift), count + GUARD)
    # The second step keeps the space of the first one: a block Krylov space of depth 2.
    change = factor.solve(vectors) * (values + shift)
    change -= vectors @ (vectors.T @ change)
    norms = np.sqrt(np.einsum("ij,ij->j", change, change))
    moving = norms > _SETTLED
    space = np.hstack([vectors, change[:, moving] / norms[moving]])
    values, vectors = _ritz(matrix, space, count)
    return values, vectors / root[:, None]


def _ritz(matrix: csc_array, space: Floats, count: int) -> tuple[Floats, Floats]:
    """Return the least eigenvalues of a matrix in a span, and orthonormal vectors (Rayleigh-Ritz)."""
    values, mixed = eigh(space.T @ (matrix @ space), space.T @ space, check_finite=False)
    return values[:count], space @ mixed[:, :count]


def _bumps(stiffness: csc_array, areas: Floats, coarse: int) -> csr_array:
    """Return smooth functions around c = `coarse` vertices, of sum 1 or 0 at each vertex, shape (n, c).

    Vertices are drawn by area, without replacement, the same for as many vertices.
    """
    size = len(areas)
    keys = np.random.default_rng(size).exponential(size=size) / areas
    centres = np.argsort(keys, kind="stable")[:coarse]
    bumps = csr_array((np.ones(coarse), (centres, np.arange(coarse))), shape=(size, coarse))
    weights = abs(stiffness)
    diffusion = csr_array(diags_array(1.0 / np.asarray(weights.sum(axis=1)).ravel()) @ weights)
    for _ in range(SPREAD):
        bumps = csr_array(diffusion @ bumps)
    total = np.asarray(bumps.sum(axis=1)).ravel()
    return csr_array(diags_array(1.0 / np.where(total > 0.0, total, 1.0)) @ bumps)
