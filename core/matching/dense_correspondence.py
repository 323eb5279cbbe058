"""A correspondence of samples extended to all vertices, by functional maps of growing size.

The pairs of the spectral correspondence determine a small orthogonal map between the Laplace-Beltrami
eigenfunctions of two surfaces; nearest neighbours under it pair all vertices, these determine a larger map,
and so on: spectral upsampling (Melzi, Ren, Rodola, Sharma, Wonka and Ovsjanikov, "ZoomOut", 2019). A few
wrong pairs are outvoted, and what the six dimensions of the embedding cannot tell apart, such as the places
around a limb, the higher eigenfunctions can. The search is run both ways from several sizes of the first map,
and the one is kept whose last map brings the two surfaces' functions closest.
"""

from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.errors import ParameterError
from core.mesh.mesh import Mesh
from core.spectral.laplace_beltrami import laplacian
from core.spectral.subspace_eigenpairs import approximate_laplace_beltrami

FUNCTIONS = 100
"""Size of the last map, the constant function counted."""

STARTS, STEP = (4, 6, 8, 12, 20, 30), 5
"""Sizes of first maps that are tried: small ones forgive wrong pairs, large ones read more from right
pairs."""

SEARCHED = 600
"""Vertices of each surface that the search reads; the last map then pairs all."""

_ROWS = 2048
"""Vertices whose nearest neighbour is looked for at a time."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions on a surface.

    Attributes
    ----------
    functions : float64, shape (n, k)
        Laplace-Beltrami eigenfunctions, the constant one first, of unit norm when the whole area is 1.
    areas : float64, shape (n,)
        Share of each vertex in the area; the sum is 1.
    """

    functions: Floats
    areas: Floats


def basis(mesh: Mesh, count: int = FUNCTIONS) -> Basis:
    """The first eigenfunctions of a mesh, as many as `count`, or as its n vertices allow.

    Parameters
    ----------
    mesh : Mesh
        Clean: no vertex twice, none without a face.
    count : int
        >= 2.
    """
    areas = laplacian(mesh)[1]
    total = float(areas.sum())
    _, functions = approximate_laplace_beltrami(mesh, min(count, len(mesh.vertices)) - 1)
    constant = np.ones((len(areas), 1))
    return Basis(np.hstack([constant, np.sqrt(total) * functions]), areas / total)


def extend(first: Basis, second: Basis, pairs: Ints) -> Ints:
    """The vertex of the second surface that corresponds to each vertex of the first.

    Parameters and errors are those of `functional_map`.

    Returns
    -------
    int64, shape (n,)
        Several vertices may share one; the given pairs are a start and need not stay.
    """
    rotation = functional_map(first, second, pairs)
    largest = len(rotation)
    return nearest_rows(first.functions[:, :largest] @ rotation, second.functions[:, :largest])[0]


def functional_map(first: Basis, second: Basis, pairs: Ints) -> Floats:
    """The orthogonal map C between the functions of two surfaces that a few pairs of vertices determine.

    Parameters
    ----------
    first, second : Basis
        Of n and m vertices.
    pairs : int, shape (p, 2)
        Vertices of the first and of the second that are known to correspond, p >= 1.

    Returns
    -------
    float64, shape (k, k)
        The rows of `first.functions[:, :k] @ C` lie near the rows of `second.functions[:, :k]` of the
        corresponding vertices; k is the size of the smaller basis.

    Raises
    ------
    ParameterError
        No pair, or of wrong shape.
    """
    if pairs.ndim != 2 or pairs.shape[1] != 2 or len(pairs) == 0:
        raise ParameterError(f"pairs must have shape (p, 2) with p at least 1, not {pairs.shape}")
    largest = min(first.functions.shape[1], second.functions.shape[1])
    starts = [size for size in STARTS if size <= min(largest, len(pairs))] or [min(largest, STARTS[0])]
    few, others = _some(first), _some(second)
    begun = [_start(first, second, pairs, size) for size in starts]
    rotations = [_upsampled(few, others, rotation, largest) for rotation in begun]
    rotations += [_upsampled(others, few, rotation.T, largest).T for rotation in begun]
    return min(rotations, key=lambda one: _residual(few, others, one))


def _some(side: Basis) -> Basis:
    """The surface at `SEARCHED` of its vertices, the same for as many vertices."""
    count = len(side.areas)
    chosen = np.random.default_rng(count).permutation(count)[:SEARCHED]
    return Basis(side.functions[chosen], side.areas[chosen] / side.areas[chosen].sum())


def _start(first: Basis, second: Basis, pairs: Ints, size: int) -> Floats:
    here, there = pairs[:, 0], pairs[:, 1]
    return _orthogonal(first.functions[here, :size].T @ second.functions[there, :size])


def _orthogonal(cross: Floats) -> Floats:
    """Procrustes: of all orthogonal maps the one that brings the paired rows closest."""
    left, _, right = np.linalg.svd(cross)
    return np.asarray(left @ right)


def _upsampled(first: Basis, second: Basis, rotation: Floats, largest: int) -> Floats:
    """The map grown from its first size to the largest."""
    while len(rotation) < largest:
        size = len(rotation)
        found, _ = nearest_rows(first.functions[:, :size] @ rotation, second.functions[:, :size])
        size = min(size + STEP, largest)
        weighted = first.areas[:, None] * first.functions[:, :size]
        rotation = _orthogonal(weighted.T @ second.functions[found, :size])
    return rotation


def _residual(first: Basis, second: Basis, rotation: Floats) -> float:
    """Mean squared distance that a map leaves between the two surfaces' functions, both ways."""
    size = len(rotation)
    one, two = first.functions[:, :size] @ rotation, second.functions[:, :size]
    return float(first.areas @ nearest_rows(one, two)[1] + second.areas @ nearest_rows(two, one)[1])


def nearest_rows(points: Floats, targets: Floats) -> tuple[Ints, Floats]:
    """The row of `targets` nearest to each row of `points`, and its squared distance.

    By products, since a hundred dimensions defeat a tree.
    """
    lengths = np.einsum("ij,ij->i", targets, targets)
    found = np.empty(len(points), dtype=np.int64)
    for start in range(0, len(points), _ROWS):
        part = slice(start, start + _ROWS)
        found[part] = np.argmin(lengths - 2.0 * (points[part] @ targets.T), axis=1)
    return found, np.asarray(((points - targets[found]) ** 2).sum(axis=1))
