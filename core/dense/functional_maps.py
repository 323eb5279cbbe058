"""A correspondence of samples extended to all vertices, by functional maps of growing size.

The pairs of the spectral correspondence determine a small orthogonal map between the Laplace-Beltrami
eigenfunctions of two surfaces; nearest neighbours under it pair all vertices, these determine a larger map,
and so on: spectral upsampling (Melzi, Ren, Rodola, Sharma, Wonka and Ovsjanikov, "ZoomOut", 2019). A few
wrong pairs are outvoted, and what the six dimensions of the embedding cannot tell apart, such as the places
around a limb, the higher eigenfunctions can. Each map is fitted to the nearest neighbours of both surfaces,
there and back, as in the bijective ZoomOut (Ren, Melzi, Wonka and Ovsjanikov, "Discrete optimization for
shape matching", 2021). Maps grow from several first sizes and from several correspondences of samples, which
may be mirror images of each other. The map is kept whose orientation is that of the samples, which brings the
two surfaces' functions closest and nearly commutes with their Laplacians, as isometries do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.dense.subspace_eigenpairs import approximate_laplace_beltrami
from core.errors import ParameterError
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.spectral.laplace_beltrami import laplacian
from core.spectral.orientation import ORIENTED, face_signs, orientation_agreement, signed_areas

FUNCTIONS = 100
"""Size of the last map, the constant function counted."""

STARTS, STEP = (6, 20), 5
"""Sizes of first maps that are tried: small ones forgive wrong pairs, large ones read more from right pairs;
and by how much they grow."""

EARLY, LATE_STEP = 40, 20
"""Size at which the best map is chosen, and by how much it then grows."""

ISOMETRIC, COMMUTING = 100.0, 60
"""Weight of the commutator of map and Laplacians beside the residual, and the number of functions in it."""

PRESERVING = 20.0
"""Weight of the agreement of orientation, beside them."""

SEARCHED, REFINED = 600, 2000
"""Vertices of each surface that all maps are fitted to, and the chosen one; the last map then pairs all."""

_ROWS = 1024
"""Rows of the first set whose products are held at a time."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions on a surface.

    Attributes
    ----------
    functions : float64, shape (n, k)
        Laplace-Beltrami eigenfunctions, the constant one first, of unit norm when the whole area is 1.
    eigenvalues : float64, shape (k,)
        Ascending from 0, when the whole area is 1.
    areas : float64, shape (n,)
        Share of each vertex in the area; the sum is 1.
    orientation : float64, shape (n, e), or None
        Signed areas (`core.spectral.orientation`) of the first functions after the constant one about each
        vertex, over its area; None if the faces are turned every way.
    """

    functions: Floats
    eigenvalues: Floats
    areas: Floats
    orientation: Floats | None


def basis(mesh: Mesh, count: int = FUNCTIONS) -> Basis:
    """Return the first eigenfunctions of a clean mesh, as many as `count` >= 2, or as its vertices allow."""
    areas = laplacian(mesh)[1]
    total = float(areas.sum())
    values, functions = approximate_laplace_beltrami(mesh, min(count, len(mesh.vertices)) - 1)
    constant = np.ones((len(areas), 1))
    functions = np.hstack([constant, np.sqrt(total) * functions])
    orientation = _orientation(mesh, functions[:, 1 : ORIENTED + 1], areas / total)
    return Basis(functions, np.concatenate([[0.0], total * values]), areas / total, orientation)


def _orientation(mesh: Mesh, functions: Floats, areas: Floats) -> Floats | None:
    signs = face_signs(mesh, face_areas(mesh.vertices, mesh.faces))
    if signs is None:
        return None
    vertices = np.arange(len(mesh.vertices))
    return signed_areas(functions, mesh.faces, signs, vertices, len(vertices)) / areas[:, None]


def extend(first: Basis, second: Basis, pairs: Ints | Sequence[Ints], mirrored: bool | None = None) -> Ints:
    """Return the vertex of the second surface that corresponds to each vertex of the first.

    Parameters and errors are those of `functional_map`.

    Returns
    -------
    int64, shape (n,)
        Several vertices may share one; the given pairs are a start and need not stay.
    """
    rotation = functional_map(first, second, pairs, mirrored)
    largest = len(rotation)
    return nearest_both_ways(first.functions[:, :largest] @ rotation, second.functions[:, :largest])[0]


def functional_map(
    first: Basis, second: Basis, pairs: Ints | Sequence[Ints], mirrored: bool | None = None
) -> Floats:
    """Return the orthogonal map C between the functions of two surfaces, from a few pairs of vertices.

    Parameters
    ----------
    first, second : Basis
        Of n and m vertices.
    pairs : int, shape (p, 2), or several such arrays
        Vertices of the first and of the second that are known to correspond, p >= 1; of several arrays one is
        near the truth.
    mirrored : bool or None
        Whether the map reverses orientation, if that is known.

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
    known = [pairs] if isinstance(pairs, np.ndarray) else pairs
    for start in known:
        if start.ndim != 2 or start.shape[1] != 2 or len(start) == 0:
            raise ParameterError(f"pairs must have shape (p, 2) with p at least 1, not {start.shape}")
    largest = min(first.functions.shape[1], second.functions.shape[1])
    few_of_first, few_of_second = _some(first, SEARCHED), _some(second, SEARCHED)
    grown = [
        _upsampled(
            few_of_first,
            few_of_second,
            _orthogonal(first.functions[start[:, 0], :size].T @ second.functions[start[:, 1], :size]),
            _sizes(size, min(EARLY, largest), STEP),
        )
        for start in known
        for size in [size for size in STARTS if size <= min(largest, len(start))] or [min(largest, STARTS[0])]
    ]
    best = min(grown, key=lambda rotation: _cost(few_of_first, few_of_second, rotation, mirrored))
    sizes = _sizes(len(best), largest, LATE_STEP) or [largest]
    return _upsampled(_some(first, REFINED), _some(second, REFINED), best, sizes)


def _cost(first: Basis, second: Basis, rotation: Floats, mirrored: bool | None) -> float:
    """Return how badly a map brings the functions together, keeps the Laplacian, and has its orientation."""
    size = len(rotation)
    rotated, targets = first.functions[:, :size] @ rotation, second.functions[:, :size]
    forward, backward = nearest_both_ways(rotated, targets)
    residual = first.areas @ _squares(rotated - targets[forward]) + second.areas @ _squares(
        targets - rotated[backward]
    )
    low = min(size, COMMUTING)
    paired = (first.areas[:, None] * first.functions[:, :low]).T @ second.functions[forward, :low]
    ours, theirs = first.eigenvalues[:low], second.eigenvalues[:low]
    commutator = np.linalg.norm((ours[:, None] - theirs) * paired) / np.linalg.norm(ours)
    cost = float(residual + ISOMETRIC * commutator)
    if mirrored is None or first.orientation is None or second.orientation is None:
        return cost
    width = first.functions[:, 1 : ORIENTED + 1].shape[1]
    weights = np.sqrt(first.areas)[:, None]
    (agreement,) = orientation_agreement(
        weights * first.orientation,
        weights * second.orientation[forward][None],
        rotation[None, 1 : width + 1, 1 : width + 1],
    )
    return cost + PRESERVING * float(agreement if mirrored else -agreement)


def _squares(rows: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", rows, rows))


def _some(side: Basis, most: int) -> Basis:
    """Return the surface at `most` of its vertices, drawn with a seed from their number."""
    count = len(side.areas)
    chosen = np.random.default_rng(count).permutation(count)[:most]
    orientation = None if side.orientation is None else side.orientation[chosen]
    areas = side.areas[chosen] / side.areas[chosen].sum()
    return Basis(side.functions[chosen], side.eigenvalues, areas, orientation)


def _orthogonal(cross: Floats) -> Floats:
    """Return the orthogonal map that brings the paired rows closest (Procrustes)."""
    left, _, right = np.linalg.svd(cross)
    return np.asarray(left @ right)


def _sizes(size: int, largest: int, step: int) -> list[int]:
    """Return the sizes to which a map of one size grows."""
    return [min(grown, largest) for grown in range(size + step, largest + step, step)]


def _upsampled(first: Basis, second: Basis, rotation: Floats, sizes: Sequence[int]) -> Floats:
    """Return the map grown to each of several sizes in turn."""
    for size in sizes:
        known = len(rotation)
        forward, backward = nearest_both_ways(
            first.functions[:, :known] @ rotation, second.functions[:, :known]
        )
        ours, theirs = first.functions[:, :size], second.functions[:, :size]
        ahead = (first.areas[:, None] * ours).T @ theirs[forward]
        rotation = _orthogonal(ahead + ours[backward].T @ (second.areas[:, None] * theirs))
    return rotation


def nearest_both_ways(ours: Floats, theirs: Floats) -> tuple[Ints, Ints]:
    """Return the nearest row of `theirs` for each of `ours`, and the nearest of `ours` for each of `theirs`.

    Products are in single precision: of two rows that are equally near but for rounding either may be found.

    Parameters
    ----------
    ours, theirs : float64, shapes (n, k) and (m, k)

    Returns
    -------
    int64, shape (n,)
    int64, shape (m,)
    """
    # The unit of length, so that squares stay within single precision.
    scale = 1.0 / max(float(np.abs(ours).max()), float(np.abs(theirs).max()), np.finfo(np.float64).tiny)
    first, second = scale * ours, scale * theirs
    # The product of these rows is the squared distance.
    ones_of_first, ones_of_second = np.ones((len(first), 1)), np.ones((len(second), 1))
    left = np.hstack([-2.0 * first, _squares(first)[:, None], ones_of_first]).astype(np.float32)
    right = np.hstack([second, ones_of_second, _squares(second)[:, None]]).astype(np.float32)
    forward = np.empty(len(left), dtype=np.int64)
    nearest_block = np.zeros(len(right), dtype=np.int64)
    least = np.full(len(right), np.inf, dtype=np.float32)
    for start in range(0, len(left), _ROWS):
        squares = left[start : start + _ROWS] @ right.T
        forward[start : start + _ROWS] = squares.argmin(axis=1)
        lowest = squares.min(axis=0)
        nearer = lowest < least
        least[nearer], nearest_block[nearer] = lowest[nearer], start
    # The minimum of a column is fast, its row is not: it is looked for in the one block that has it.
    backward = np.empty(len(right), dtype=np.int64)
    for start in range(0, len(left), _ROWS):
        columns = np.flatnonzero(nearest_block == start)
        backward[columns] = start + (right[columns] @ left[start : start + _ROWS].T).argmin(axis=1)
    return forward, backward
