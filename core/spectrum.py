"""Affinity of the samples, its eigenvectors, and the k-dimensional embedding (section 3.3)."""

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from core.errors import ParameterError
from core.mesh import Floats

SPARSE_FROM = 600
"""From so many samples on, the leading eigenpairs come from the iterative solver: the dense one costs m^3."""

EQUAL_VALUES = 1e-4
"""Eigenvalues, and sums of cubes, that differ by less than this part are equal."""


def gaussian_affinity(distances: Floats, width: float) -> Floats:
    """W = exp(-d^2 / 2 s^2), s = `width` times the mean distance; ones on the diagonal, shape (m, m).

    Raises
    ------
    ParameterError
        The width is not positive.
    """
    if not width > 0.0:
        raise ParameterError(f"the affinity's width must be positive, not {width}")
    count = len(distances)
    mean = float(distances.sum()) / (count * (count - 1))
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


def spectral_coordinates(values: Floats, vectors: Floats, power: float) -> Floats:
    """Rows of the eigenvectors as points of the spectral domain, shape (m, k).

    Each column is multiplied by its eigenvalue's magnitude to the `power` (0: the paper's plain
    eigenvectors; 1/2: kernel principal components; -1/2 for a Laplacian: the global point signature).
    The cloud is then centred and scaled to unit root mean square radius.
    """
    floor = 1e-9 * float(np.abs(values).max())
    points = vectors * np.maximum(np.abs(values), floor) ** power
    points = points - points.mean(axis=0)
    return np.asarray(points / np.sqrt((points**2).sum(axis=1).mean()))


def affinity_signature(values: Floats, count: int) -> Floats:
    """Logarithms of the leading eigenvalues' magnitudes over their number m, shape (s,).

    A Gaussian affinity's eigenvalues sum to m, so they are comparable between sample counts.
    """
    return np.asarray(np.log(np.maximum(np.abs(values) / count, 1e-6)))


def laplacian_signature(values: Floats) -> Floats:
    """Logarithms of Laplace-Beltrami eigenvalues over the first (ShapeDNA, Reuter 2006), shape (s,)."""
    floor = 1e-6 * float(values[-1])
    return np.asarray(np.log(np.maximum(values, floor) / max(float(values[0]), floor)))
