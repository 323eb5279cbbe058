"""A correspondence of samples extended to all vertices, by functional maps of growing size.

The pairs of the spectral correspondence determine a small orthogonal map between the Laplace-Beltrami
eigenfunctions of two surfaces; nearest neighbours under it pair all vertices, these determine a larger map,
and so on: spectral upsampling (Melzi, Ren, Rodola, Sharma, Wonka and Ovsjanikov, "ZoomOut", 2019). A few
wrong pairs are outvoted, and what the six dimensions of the embedding cannot tell apart, such as the places
around a limb, the higher eigenfunctions can. Each map is fitted to the nearest neighbours of both surfaces,
there and back, as in the bijective ZoomOut (Ren, Melzi, Wonka and Ovsjanikov, "Discrete optimization for
shape matching", 2021). Maps grow from several first sizes and from several correspondences of samples, which
may be mirror images of each other or turned about a long axis; if none fits, from the signs of the first
functions too. At full size the map is kept which brings the two surfaces' functions closest, nearly commutes
with their Laplacians, as isometries do, and brings ridges to ridges and hollows to hollows: a turned map of
a body preserves lengths and orientation, and its mean curvature tells front from back. A map that reverses
orientation is kept if it brings functions closer nearly everywhere: one shape is then like the mirror image
of the other. The kept map may grow further, with mean curvatures beside the functions, which draw ridges to
ridges; its functions are the canonical ones of the paired surfaces, and count by their correlations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from core.arrays import Floats, Ints
from core.dense.subspace_eigenpairs import approximate_laplace_beltrami
from core.errors import ParameterError
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.spectral.laplace_beltrami import laplacian
from core.spectral.orientation import ORIENTED, face_signs, orientation_agreement, signed_areas

FUNCTIONS, FINE = 100, 300
"""Size of the maps among which one is chosen, the constant function counted, and of the last map if it is
fine."""

RECONSTRUCTED = (FUNCTIONS, 200, FINE)
"""Numbers of functions that reconstruct the surfaces whose mean curvatures stand beside the functions."""

RIDGES, LEAST_RIDGES = 2.0, 1.0
"""Weight of mean curvatures of standard deviation 1 beside 100 functions; and the least standard deviation,
when the whole area is 1, that they are divided by: below it a surface is round everywhere."""

STARTS, STEP = (6, 20), 5
"""Sizes of first maps that are tried: small ones forgive wrong pairs, large ones read more from right pairs;
and by how much they grow."""

EARLY, LATE_STEP = 40, 20
"""Size at which the best of the maps from one correspondence of samples is chosen, and by how much it then
grows."""

UNFIT, SIGNED = -10.0, (4, 5)
"""Least cost of the maps of `EARLY` functions from the samples, above which the signs of so many first
functions, the constant one counted, give further starts: wrong maps of individuals cost 2 to 25, right ones
less."""

ISOMETRIC, COMMUTING = 100.0, 60
"""Weight of the commutator of map and Laplacians beside the residual, and the number of functions in it."""

PRESERVING, RIDGED = 20.0, 50.0
"""Weights of the agreement of orientation, and of the correlation of mean curvatures, beside them."""

LEAST_TO_START, EACH, MOST_HELD = 3, 0.01, 0.5
"""Landmarks that give a start of their own; the share of the area that each counts for, and all at most."""

HOLDING, BIHARMONIC = 300.0, 30
"""Weight of the distance of landmarks beside the residual, and the functions of biharmonic distances."""

FITS_AS_WELL, SCATTER, UNLIKE = 4.5, 0.06, 20.0
"""Largest difference of the costs of maps that fit about equally well, how much it grows with the cost of the
best map, and the cost above which it grows. Between poses, of cost -50 to 0, the maps of octopus, pliers and
snake differ by 0 to 4; between unlike octopuses, of cost 100, by 7; wrong maps of bodies by 10 and more."""

DIFFERENT = 0.5
"""Least share of the area whose images are elsewhere under different maps: the mean squared distance of the
images in the first `COMMUTING` functions, over that of two points of the surface. Low functions alone do not
see a snake that is turned about its length."""

CLEAR = 0.4
"""Least agreement of orientation, or of its negative, by which a map may differ from its start."""

EVIDENT = 0.15
"""Least contrast of residuals, in [-1, 1], of a map that reverses orientation: the mean over both surfaces of
the relative difference of the residuals of two maps. Between a body made by code and the mirror image of
another pose it is mostly 0.17 to 0.56, but -0.06 to 0.1 for hand, octopus and snake; between poses of one
scanned body it is at most 0.13."""

SEARCHED, REFINED = 600, 2000
"""Vertices of each surface that all maps are fitted to while they are small, and the later ones; the last map
then pairs all."""

FINE_STEP, FINELY_REFINED = 25, 3500
"""By how much a map grows from `FUNCTIONS` to `FINE`, and the vertices of each surface that fit it."""

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
    curvature : float64, shape (n, c), or None
        Twice the mean curvatures of the surfaces that the first `RECONSTRUCTED` functions reconstruct, as far
        as there are so many, when the whole area is 1; negative where they are convex. None with
        `orientation`.
    """

    functions: Floats
    eigenvalues: Floats
    areas: Floats
    orientation: Floats | None
    curvature: Floats | None

    @property
    def biharmonic(self) -> Floats:
        """Rows whose distances are the biharmonic ones (Lipman et al. 2010), shape (n, l)."""
        low = slice(1, BIHARMONIC + 1)
        return np.asarray(self.functions[:, low] / self.eigenvalues[low])


class Held(NamedTuple):
    """The functions at l landmarks of two surfaces, shapes (l, k): rows that a map brings together."""

    first: Floats
    second: Floats

    def cross(self, size: int) -> Floats:
        """Return what the landmarks add to the product that gives a map of some size."""
        share = min(EACH, MOST_HELD / len(self.first))
        return np.asarray(share * self.first[:, :size].T @ self.second[:, :size])

    def gap(self, rotation: Floats, eigenvalues: Floats) -> float:
        """Return the mean squared biharmonic distance of landmarks under a map, over that of two points."""
        low = slice(1, BIHARMONIC + 1)
        gaps = (self.first[:, : len(rotation)] @ rotation - self.second[:, : len(rotation)])[:, low]
        weights = 1.0 / eigenvalues[low] ** 2
        return float((gaps**2 @ weights).mean() / (2.0 * weights.sum()))


Domain = tuple[Floats, Floats]
"""Matrices (k, k) that bring k functions of either surface to a common domain, where partners are near."""


class FunctionalMap(NamedTuple):
    """A map between functions, how many maps, itself counted, fit about as well, and its cost.

    It is `mirrored` if it reverses orientation, since it fits evidently better than maps that preserve it;
    None if orientations are unknown.
    """

    domain: Domain
    fitting: int
    cost: float
    mirrored: bool | None

    def partners(self, first: Basis, second: Basis) -> Ints:
        """Return the vertex of the second surface for each of n of the first; several may share one."""
        return nearest_both_ways(*compared_rows(first, second, self.domain))[0]


def basis(mesh: Mesh, count: int) -> Basis:
    """Return the first eigenfunctions of a clean mesh, as many as `count` >= 2, or as its vertices allow."""
    areas = laplacian(mesh)[1]
    total = float(areas.sum())
    values, functions = approximate_laplace_beltrami(mesh, min(count, len(mesh.vertices)) - 1)
    eigenvalues = np.concatenate([[0.0], total * values])
    functions = np.hstack([np.ones((len(areas), 1)), np.sqrt(total) * functions])
    shares = areas / total
    signs = face_signs(mesh, face_areas(mesh.vertices, mesh.faces))
    if signs is None:
        return Basis(functions, eigenvalues, shares, None, None)
    vertices = np.arange(len(mesh.vertices))
    planes = signed_areas(functions[:, 1 : ORIENTED + 1], mesh.faces, signs, vertices, len(vertices))
    curvature = _mean_curvatures(mesh, signs, functions, eigenvalues, shares) / np.sqrt(total)
    return Basis(functions, eigenvalues, shares, planes / shares[:, None], curvature)


def _mean_curvatures(
    mesh: Mesh, signs: Floats, functions: Floats, eigenvalues: Floats, areas: Floats
) -> Floats:
    """Return twice the mean curvatures of the surfaces that functions reconstruct, shape (n, c).

    The Laplacian of the positions, the sum of -lambda_i <phi_i, x> phi_i, is along the normal.
    """
    corners = mesh.vertices[mesh.faces]
    face_normals = signs[:, None] * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], face_normals)
    lengths = np.linalg.norm(normals, axis=1)
    normals /= np.where(lengths > 0.0, lengths, 1.0)[:, None]
    coefficients = -eigenvalues[:, None] * (functions.T @ (areas[:, None] * mesh.vertices))
    sizes = [size for size in RECONSTRUCTED if size <= len(eigenvalues)] or [len(eigenvalues)]
    laplacians = (functions[:, :size] @ coefficients[:size] for size in sizes)
    return np.stack([np.einsum("nx,nx->n", normals, each) for each in laplacians], axis=1)


def functional_map(
    first: Basis,
    second: Basis,
    pairs: Ints | Sequence[Ints],
    mirrored: Sequence[bool] | None = None,
    landmarks: Ints | None = None,
) -> FunctionalMap:
    """Return the map between the functions of two surfaces, from a few pairs of vertices.

    Parameters
    ----------
    first, second : Basis
        Of n and m vertices.
    pairs : int, shape (p, 2), or several such arrays
        Vertices of the first and of the second that are known to correspond, p >= 1; of several arrays one is
        near the truth.
    mirrored : sequence of bool or None
        Which of several arrays reverse orientation, if that is known.
    landmarks : int, shape (l, 2), or None
        Vertices that correspond for sure: maps are fitted to them as well, and chosen by them. From
        `LEAST_TO_START` on, they give one more start.

    Returns
    -------
    FunctionalMap
        With A and B its domain, the rows of `first.functions[:, :k] @ A` lie near the rows of
        `second.functions[:, :k] @ B` of the corresponding vertices; k is the size of the smaller basis.

    Raises
    ------
    ParameterError
        No pair, or of wrong shape.
    """
    known = [pairs] if isinstance(pairs, np.ndarray) else list(pairs)
    for start in known:
        if start.ndim != 2 or start.shape[1] != 2 or len(start) == 0:
            raise ParameterError(f"pairs must have shape (p, 2) with p at least 1, not {start.shape}")
    largest = min(first.functions.shape[1], second.functions.shape[1])
    few = _some(first, SEARCHED), _some(second, SEARCHED)
    some = _some(first, REFINED), _some(second, REFINED)
    held = None
    if landmarks is not None and len(landmarks):
        held = Held(first.functions[landmarks[:, 0]], second.functions[landmarks[:, 1]])
        if len(landmarks) >= LEAST_TO_START:
            known.append(_by_distances(first, second, landmarks))
    oriented = first.orientation is not None and second.orientation is not None
    signs = np.zeros(len(known))
    if mirrored is not None:
        signs[: len(mirrored)] = np.where(mirrored, -1.0, 1.0)
    small: list[Floats] = []
    least = np.inf
    for start, sign in zip(known, signs, strict=True):
        # Grow a map from each first size, and keep the best of one start.
        sizes = [size for size in STARTS if size <= min(largest, len(start))] or [min(largest, STARTS[0])]
        grown = [
            _upsampled(
                *few,
                _orthogonal(first.functions[start[:, 0], :size].T @ second.functions[start[:, 1], :size]),
                _sizes(size, min(EARLY, largest), STEP),
                held,
            )
            for size in sizes
        ]
        early = [_fit(*few, rotation, held).cost(sign) for rotation in grown]
        small.append(grown[int(np.argmin(early))])
        least = min(least, *early)
    if least > UNFIT:
        small += _from_signs(*few, min(EARLY, largest), held, least)
        signs = np.append(signs, np.zeros(len(small) - len(signs)))
    # Choose among the starts at full size, where mean curvature tells a turned map from the right one.
    whole = min(FUNCTIONS, largest)
    maps = [
        _upsampled(*some, rotation, _sizes(len(rotation), whole, LATE_STEP) or [whole], held)
        for rotation in small
    ]
    fits = [_fit(*some, rotation, held) for rotation in maps]
    # A map may have drifted to the other orientation.
    agreements = np.array([fit.agreement for fit in fits])
    signs = np.where((signs == 0.0) | (np.abs(agreements) >= CLEAR), np.sign(agreements), signs)
    costs = np.array([fit.cost(sign) for fit, sign in zip(fits, signs, strict=True)])
    reverses = oriented & (signs < 0.0)
    chosen = _chosen(fits, costs, reverses, (some[0].areas, some[1].areas), by_cost=held is not None)
    most = costs[chosen] + FITS_AS_WELL + SCATTER * max(costs[chosen] - UNLIKE, 0.0)
    # Orientation that is unclear though maps fit, as of a snake, does not tell them apart.
    unclear = (np.abs(agreements) < CLEAR) & (costs <= UNLIKE)
    fits_too = ((reverses == reverses[chosen]) | (unclear & unclear[chosen])) & (costs <= most)
    order = np.argsort(costs, kind="stable")
    count = len(_different(*some, [maps[which] for which in order if fits_too[which]]))
    domain = maps[chosen], np.eye(whole)
    if whole < largest:
        finer = _some(first, FINELY_REFINED), _some(second, FINELY_REFINED)
        domain = _canonical(*finer, domain, _sizes(whole, largest, FINE_STEP), held)
    return FunctionalMap(domain, count, float(costs[chosen]), bool(reverses[chosen]) if oriented else None)


def _chosen(
    fits: Sequence["_Fit"],
    costs: Floats,
    reverses: NDArray[np.bool_],
    areas: tuple[Floats, Floats],
    *,
    by_cost: bool,
) -> int:
    """Return which map is kept: one that reverses orientation only if it evidently fits better.

    A wrong limb may add more to the cost of a map than the asymmetry of a body does, but only in one place.
    `by_cost` lets costs alone decide.
    """
    preserving, reversing = (
        int(np.where(kind, costs, np.inf).argmin()) if kind.any() else None for kind in (~reverses, reverses)
    )
    if preserving is None or reversing is None:
        return int(costs.argmin())
    if by_cost:
        return reversing if costs[reversing] < costs[preserving] - FITS_AS_WELL else preserving
    contrasts = [
        shares @ ((ours - theirs) / np.maximum(ours + theirs, np.finfo(np.float64).tiny))
        for shares, ours, theirs in zip(areas, fits[preserving].gaps, fits[reversing].gaps, strict=True)
    ]
    return reversing if np.mean(contrasts) >= EVIDENT else preserving


def _different(first: Basis, second: Basis, maps: Sequence[Floats]) -> list[Ints]:
    """Return the partners of all vertices under each map that is unlike those before it."""
    rows = second.functions[:, 1:COMMUTING]
    spread = 2.0 * float(second.areas @ _squares(rows))
    kept: list[Ints] = []
    for rotation in maps:
        size = len(rotation)
        partners = nearest_both_ways(first.functions[:, :size] @ rotation, second.functions[:, :size])[0]
        apart = (float(first.areas @ _squares(rows[partners] - rows[others])) / spread for others in kept)
        if all(each > DIFFERENT for each in apart):
            kept.append(partners)
    return kept


def _from_signs(first: Basis, second: Basis, size: int, held: Held | None, least: float) -> list[Floats]:
    """Return the best map of each orientation that grows from the signs of the first functions alone.

    Between unlike individuals the samples may miss the right map. Small maps grow by one function at a time:
    larger steps lose it. Maps that cost more than `least`, the best map from the samples, are left out.
    """
    small = min(size, STARTS[-1])
    maps = [
        _upsampled(
            first,
            second,
            np.diag([1.0, *signs]),
            [*range(count + 1, small + 1), *_sizes(small, size, STEP)],
            held,
        )
        for count in SIGNED
        if count <= size
        for signs in product((1.0, -1.0), repeat=count - 1)
    ]
    fits = [_fit(first, second, rotation, held) for rotation in maps]
    reverses = [fit.agreement < 0.0 for fit in fits]
    costs = np.array([fit.cost() for fit in fits])
    best = [int(np.where(np.equal(reverses, kind), costs, np.inf).argmin()) for kind in sorted(set(reverses))]
    return [maps[which] for which in best if costs[which] < least]


def _by_distances(first: Basis, second: Basis, landmarks: Ints) -> Ints:
    """Return pairs of vertices that have alike biharmonic distances from the landmarks, shape (p, 2)."""
    count = len(first.areas)
    here = np.random.default_rng(count).permutation(count)[:SEARCHED]
    near = []
    for side, ends in zip((first, second), landmarks.T, strict=True):
        rows = side.biharmonic
        near.append(cdist(rows, rows[ends]))
    return np.stack([here, cKDTree(near[1]).query(near[0][here])[1]], axis=1)


class _Fit(NamedTuple):
    """How badly a map fits, and whether it preserves orientation, from -1 to 1; 0 if that is unknown.

    `gaps`, shapes (n,) and (m,), are the squared distances of both surfaces' functions from their partners.
    """

    plain: float
    agreement: float
    gaps: tuple[Floats, Floats]

    def cost(self, sign: float = 0.0) -> float:
        """Return the cost of a map that should preserve orientation (1), reverse it (-1), or either (0)."""
        return self.plain - PRESERVING * (sign * self.agreement if sign else abs(self.agreement))


def _fit(first: Basis, second: Basis, rotation: Floats, held: Held | None) -> _Fit:
    """Return how well a map fits functions, landmarks, Laplacian and curvature; and orientation."""
    size = len(rotation)
    rotated, targets = first.functions[:, :size] @ rotation, second.functions[:, :size]
    forward, backward = nearest_both_ways(rotated, targets)
    gaps = _squares(rotated - targets[forward]), _squares(targets - rotated[backward])
    residual = first.areas @ gaps[0] + second.areas @ gaps[1]
    low = min(size, COMMUTING)
    paired = (first.areas[:, None] * first.functions[:, :low]).T @ second.functions[forward, :low]
    ours, theirs = first.eigenvalues[:low], second.eigenvalues[:low]
    commutator = np.linalg.norm((ours[:, None] - theirs) * paired) / np.linalg.norm(ours)
    cost = float(residual + ISOMETRIC * commutator)
    if held is not None:
        cost += HOLDING * held.gap(rotation, theirs)
    if first.curvature is not None and second.curvature is not None:
        cost -= RIDGED * _correlation(first.curvature[:, 0], second.curvature[forward, 0], first.areas)
    if first.orientation is None or second.orientation is None:
        return _Fit(cost, 0.0, gaps)
    width = first.functions[:, 1 : ORIENTED + 1].shape[1]
    weights = np.sqrt(first.areas)[:, None]
    (agreement,) = orientation_agreement(
        weights * first.orientation,
        weights * second.orientation[forward][None],
        rotation[None, 1 : width + 1, 1 : width + 1],
    )
    return _Fit(cost, float(agreement), gaps)


def _correlation(first: Floats, second: Floats, areas: Floats) -> float:
    """Return the correlation over the area of two functions, in [-1, 1]; 0 if one is constant."""
    first, second = first - areas @ first, second - areas @ second
    size = np.sqrt((areas @ first**2) * (areas @ second**2))
    return float(areas @ (first * second) / size) if size > 0.0 else 0.0


def _squares(rows: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", rows, rows))


def _some(side: Basis, most: int) -> Basis:
    """Return the surface at `most` of its vertices, drawn with a seed from their number."""
    count = len(side.areas)
    chosen = np.random.default_rng(count).permutation(count)[:most]
    orientation = None if side.orientation is None else side.orientation[chosen]
    curvature = None if side.curvature is None else side.curvature[chosen]
    areas = side.areas[chosen] / side.areas[chosen].sum()
    return Basis(side.functions[chosen], side.eigenvalues, areas, orientation, curvature)


def _orthogonal(cross: Floats) -> Floats:
    """Return the orthogonal map that brings the paired rows closest (Procrustes)."""
    left, _, right = np.linalg.svd(cross)
    return np.asarray(left @ right)


def _sizes(size: int, largest: int, step: int) -> list[int]:
    """Return the sizes to which a map of one size grows."""
    return [min(grown, largest) for grown in range(size + step, largest + step, step)]


def _upsampled(
    first: Basis, second: Basis, rotation: Floats, sizes: Sequence[int], held: Held | None = None
) -> Floats:
    """Return the map grown to each of several sizes in turn, fitted to landmarks."""
    for size in sizes:
        known = len(rotation)
        partners = nearest_both_ways(first.functions[:, :known] @ rotation, second.functions[:, :known])
        rotation = _orthogonal(_cross(first, second, partners, size, held))
    return rotation


def _canonical(
    first: Basis, second: Basis, domain: Domain, sizes: Sequence[int], held: Held | None
) -> Domain:
    """Return the domain grown to each of several sizes in turn, fitted to ridges and landmarks.

    Its functions are the canonical ones (Hotelling 1936) of the surfaces under the partners of both. Each
    counts by its correlation, so the product of two rows is that under the best linear map.
    """
    for size in sizes:
        partners = nearest_both_ways(*compared_rows(first, second, domain))
        left, twice, right = np.linalg.svd(_cross(first, second, partners, size, held))
        roots = np.sqrt(np.minimum(0.5 * twice, 1.0))
        domain = left * roots, right.T * roots
    return domain


def _cross(first: Basis, second: Basis, partners: tuple[Ints, Ints], size: int, held: Held | None) -> Floats:
    """Return the products of both surfaces' functions over the partners, there and back, and landmarks."""
    forward, backward = partners
    ours, theirs = first.functions[:, :size], second.functions[:, :size]
    ahead = (first.areas[:, None] * ours).T @ theirs[forward]
    cross = ahead + ours[backward].T @ (second.areas[:, None] * theirs)
    return np.asarray(cross if held is None else cross + held.cross(size))


def compared_rows(first: Basis, second: Basis, domain: Domain) -> tuple[Floats, Floats]:
    """Return rows of n and m vertices, shapes (n, k + c) and (m, k + c), that are near for partners.

    They are the k functions of both in the common domain, and weighted mean curvatures.
    """
    size = len(domain[0])
    rows = [[side.functions[:, :size] @ into] for side, into in zip((first, second), domain, strict=True)]
    if first.curvature is not None and second.curvature is not None:
        curvatures = first.curvature, second.curvature
        width = min(curvature.shape[1] for curvature in curvatures)
        for side, curvature, own in zip((first, second), curvatures, rows, strict=True):
            ridges = curvature[:, :width] - side.areas @ curvature[:, :width]
            deviations = np.sqrt(side.areas @ ridges**2)
            weight = RIDGES * np.sqrt(size / FUNCTIONS)
            own.append(weight * ridges / np.maximum(deviations, LEAST_RIDGES))
    return np.hstack(rows[0]), np.hstack(rows[1])


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
