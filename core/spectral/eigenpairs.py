"""Eigenpairs of the affinity, with signs and directions that the shape itself gives (section 3.3)."""

import numpy as np
from scipy.linalg import eigh, svd
from scipy.sparse.linalg import eigsh

from core.arrays import Floats

SPARSE_FROM = 600
"""From so many samples on, the leading eigenpairs come from the iterative solver: the dense one costs m^3."""


EQUAL_VALUES = 1e-4
"""Eigenvalues, and sums of cubes, that differ by less than this part are equal."""


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
        rotation = np.empty((len(shared), 0))
        for _ in shared:
            lengths = np.linalg.norm(rest, axis=1)
            row = rest[np.argmax(lengths > 0.5 * lengths.max())]
            rotation = np.c_[rotation, row / np.linalg.norm(row)]
            rest = vectors[:, shared] - vectors[:, shared] @ rotation @ rotation.T
        result[:, shared] = vectors[:, shared] @ rotation
    return result[:, :count]
