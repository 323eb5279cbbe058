"""Affinity of the samples, its eigenvectors, and the k-dimensional embedding (section 3.3)."""

import numpy as np
from scipy.linalg import eigh, svd
from scipy.sparse.linalg import eigsh

from core.errors import ParameterError
from core.mesh import Floats

SPARSE_FROM = 600
"""From so many samples on, the leading eigenpairs come from the iterative solver: the dense one costs m^3."""

EQUAL_VALUES = 1e-4
"""Eigenvalues, and sums of cubes, that differ by less than this part are equal."""

FADED = 1e-6
"""A tapered column keeps so much of the largest squared weight: the spline needs every dimension."""

FAINTEST = 1e-2
"""An eigenvalue times the area below this is this: a tube a thousand times as long as wide has 0.03."""


def gaussian_affinity(distances: Floats, width: float, areas: Floats | None = None) -> Floats:
    """W = exp(-d^2 / 2 s^2), s = `width` times the mean distance; ones where the distance is 0.

    Parameters
    ----------
    distances : float64, shape (m, m), or (d, m) with areas
    width : float
    areas : float64, shape (m,), optional
        Shares that weigh the columns in the mean; without them it is that of distinct samples.

    Raises
    ------
    ParameterError
        The width is not positive.
    """
    if not width > 0.0:
        raise ParameterError(f"the affinity's width must be positive, not {width}")
    count = len(distances)
    mean = (
        float(distances.sum()) / (count * (count - 1)) if areas is None else float((distances @ areas).mean())
    )
    return np.asarray(np.exp(-(distances**2) / (2.0 * (width * mean) ** 2)))


def distance_affinity(distances: Floats) -> Floats:
    """The literal Eq. 13: distances over their mean off the diagonal, ones on it, shape (m, m)."""
    count = len(distances)
    mean = float(distances.sum()) / (count * (count - 1))
    affinity = distances / mean
    np.fill_diagonal(affinity, 1.0)
    return affinity


def leading_eigenpairs(affinity: Floats, count: int) -> tuple[Floats, Floats]:
    """The `count` eigenvalues of largest magnitude, that first, and their unit eigenvectors (W = Q L Q^T).

    A Gaussian affinity has no negative eigenvalues. Distances along a tree have one positive eigenvalue, and
    what tells of the shape is in the large negative ones; the largest by sign would be noise.

    Signs, and directions where eigenvalues are equal, are those of `oriented`.

    Returns
    -------
    float64, shape (count,)
    float64, shape (m, count)
    """
    size = len(affinity)
    if size < SPARSE_FROM:
        values, vectors = eigh(affinity, check_finite=False)
    else:
        values, vectors = eigsh(affinity, k=count, which="LM", v0=np.ones(size))
    order = np.argsort(-np.abs(values), kind="stable")
    return values[order[:count]], oriented(values[order], vectors[:, order], count)


def sampled_eigenpairs(affinity: Floats, areas: Floats, count: int) -> tuple[Floats, Floats]:
    """Eigenpairs of the affinity as an operator on the surface, read at more points than the samples.

    The operator (W f)(p) is the integral of W(p, q) f(q) over the surface; the samples, each standing for the
    area of its region, are the quadrature (Nystrom). The singular pairs of W(point, sample) sqrt(area) are
    those of W W^T, so where the samples happen to lie, and how many lie where, matters to second order: the
    leading functions of one shape meshed twice agree far better than those of a matrix between samples.

    Parameters
    ----------
    affinity : float64, shape (d, m)
        Between points spread evenly over the surface, and the samples.
    areas : float64, shape (m,)
        Share of the surface that is nearest to each sample; they sum to 1.
    count : int
        At most m.

    Returns
    -------
    float64, shape (count,)
        Falling. 1 for the constant affinity.
    float64, shape (d, count)
        Orthonormal columns, signs and directions those of `oriented`.
    """
    left, values, _ = svd(affinity * np.sqrt(areas), full_matrices=False, check_finite=False)
    return values[:count] / np.sqrt(len(affinity)), oriented(values, left, count)


def oriented(values: Floats, vectors: Floats, count: int) -> Floats:
    """The first `count` eigenvectors, with signs and, where eigenvalues are equal, directions of their own.

    A vector is turned so that the sum of its cubes is positive. Where that vanishes, as for an odd function
    on a symmetric shape, and where several share an eigenvalue, rounding would choose, so the rows decide:
    the first row that is large in the shared space lies along its first vector, the next row that is large
    in what is left along the second, and so on.

    Parameters
    ----------
    values : float64, shape (s,)
        In order.
    vectors : float64, shape (m, s)
        Some more than `count` where that would part equal ones.
    count : int

    Returns
    -------
    float64, shape (m, count)
    """
    result = vectors.copy()
    sizes = np.abs(values)
    far = np.abs(np.diff(values)) > EQUAL_VALUES * np.maximum(sizes[1:], sizes[:-1])
    for shared in np.split(np.arange(len(values)), np.flatnonzero(far) + 1):
        if shared[0] >= count:
            break
        cubes = vectors[:, shared] ** 3
        if len(shared) == 1 and abs(cubes.sum()) > EQUAL_VALUES * np.abs(cubes).sum():
            result[:, shared] *= np.sign(cubes.sum())
            continue
        rest = vectors[:, shared]
        turn = np.empty((len(shared), 0))
        for _ in shared:
            lengths = np.linalg.norm(rest, axis=1)
            row = rest[np.argmax(lengths > 0.5 * lengths.max())]
            turn = np.c_[turn, row / np.linalg.norm(row)]
            rest = vectors[:, shared] - vectors[:, shared] @ turn @ turn.T
        result[:, shared] = vectors[:, shared] @ turn
    return result[:, :count]


def spectral_coordinates(values: Floats, vectors: Floats, power: float, *, taper: bool = False) -> Floats:
    """Rows of the eigenvectors as points of the spectral domain, shape (m, k).

    Each column is multiplied by its eigenvalue's magnitude to the `power` (0: the paper's plain
    eigenvectors; 1/2: kernel principal components; -1/2 for a Laplacian: the global point signature).
    The cloud is then centred and scaled to unit root mean square radius.

    Where the last eigenvalue kept is close to the first left out, a small change of the shape swaps their
    vectors. Tapered, the square of each weight is lessened by that of the first eigenvalue left out, so that
    the last columns fade to nothing as the two come together.

    Parameters
    ----------
    values : float64, shape (s,), s >= k
        In order of importance; tapering needs s > k.
    vectors : float64, shape (m, k)
    power : float
    taper : bool
    """
    kept = vectors.shape[1]
    floor = 1e-9 * float(np.abs(values).max())
    squares = np.maximum(np.abs(values), floor) ** (2.0 * power)
    if taper:
        squares = np.maximum(squares - squares[kept], FADED * squares.max())
    points = vectors * np.sqrt(squares[:kept])
    points = points - points.mean(axis=0)
    return np.asarray(points / np.sqrt((points**2).sum(axis=1).mean()))


def affinity_signature(values: Floats) -> Floats:
    """Logarithms of the leading eigenvalues' magnitudes over the root of their number, shape (s,).

    They must be over the number of samples, or of the operator on the surface: then a Gaussian affinity's sum
    to 1 or less, and they are comparable whatever the number.
    """
    return np.asarray(np.log(np.maximum(np.abs(values), 1e-6)) / np.sqrt(max(1, len(values))))


def laplacian_signature(values: Floats, area: float) -> Floats:
    """Logarithms of Laplace-Beltrami eigenvalues times the area, over the root of their number, shape (s,).

    ShapeDNA (Reuter, Wolter, Peinecke 2006) free of size by the area: the first eigenvalue, which its authors
    divide by, is the one that a thin neck or a loose part moves most. The distance between two is the root
    mean square difference of logarithms, whatever the number.
    """
    return np.asarray(np.log(np.maximum(values * area, FAINTEST)) / np.sqrt(max(1, len(values))))
