"""Affinity matrices of the samples (section 3.3, Eq. 13), and their eigenpairs.

Signs and directions of eigenvectors follow from the shape.
"""

import numpy as np
from scipy.linalg import eigh, svd
from scipy.sparse.linalg import eigsh

from core.arrays import Floats
from core.errors import ParameterError

SPARSE_FROM = 600
"""From this number of samples on, the iterative solver is used; the dense solver costs O(m^3)."""

EQUAL_VALUES = 1e-4
"""Relative difference below which eigenvalues, and sums of cubes, are equal."""


def gaussian_affinity(distances: Floats, width: float, areas: Floats | None = None) -> Floats:
    """Return the Gaussian affinity W = exp(-d^2 / 2 s^2), in [0, 1]; s is `width` times the mean distance.

    Distances >= 0 have the shape (m, m) or, with areas, (d, m). `areas`, shape (m,), of sum 1, weight the
    columns in the mean; without them it is over pairs of distinct samples. Raise ParameterError if the width
    is not positive.
    """
    if not width > 0.0:
        raise ParameterError(f"the affinity's width must be positive, not {width}")
    count = len(distances)
    mean = (
        float(distances.sum()) / (count * (count - 1)) if areas is None else float((distances @ areas).mean())
    )
    return np.asarray(np.exp(-(distances**2) / (2.0 * (width * mean) ** 2)))


def distance_affinity(distances: Floats) -> Floats:
    """Return the literal Eq. 13: symmetric distances over their mean off the diagonal, 1 on it, (m, m)."""
    count = len(distances)
    mean = float(distances.sum()) / (count * (count - 1))
    affinity = distances / mean
    np.fill_diagonal(affinity, 1.0)
    return affinity


def leading_eigenpairs(affinity: Floats, count: int) -> tuple[Floats, Floats]:
    """Return the `count` eigenvalues of largest magnitude, and their unit eigenvectors (W = Q L Q^T).

    A Gaussian affinity has no negative eigenvalues. A matrix of tree distances has one positive eigenvalue;
    its large negative eigenvalues describe the shape, and small positive ones are rounding. Eigenvalues,
    shape (count,), are by descending magnitude; eigenvectors are in columns, shape (m, count), as of
    `oriented`.
    """
    size = len(affinity)
    if size < SPARSE_FROM:
        values, vectors = eigh(affinity, check_finite=False)
    else:
        values, vectors = eigsh(affinity, k=count, which="LM", v0=np.ones(size))
    order = np.argsort(-np.abs(values), kind="stable")
    return values[order[:count]], oriented(values[order], vectors[:, order], count)


def sampled_eigenpairs(affinity: Floats, areas: Floats, count: int) -> tuple[Floats, Floats]:
    """Return eigenpairs of the affinity as an integral operator on the surface, at d points.

    The operator is (W f)(p) = integral of W(p, q) f(q) over the surface. The samples, weighted by the areas
    of their regions, are its quadrature nodes (Nystrom method). The singular pairs of
    W(point, sample) sqrt(area) are the eigenpairs of W W^T, so positions and density of the samples have an
    effect of second order only: the leading eigenfunctions of two meshings of one shape agree far better than
    those of the matrix between samples.

    The affinity, shape (d, m), is between d points, evenly spread over the surface, and the m samples;
    `areas`, shape (m,), are the shares of the surface in their regions. Eigenvalues, shape (count,), count <=
    m, descend, 1 for the constant affinity; eigenvectors are orthonormal columns, shape (d, count), as of
    `oriented`.
    """
    left, values, _ = svd(affinity * np.sqrt(areas), full_matrices=False, check_finite=False)
    return values[:count] / np.sqrt(len(affinity)), oriented(values, left, count)


def oriented(values: Floats, vectors: Floats, count: int) -> Floats:
    """Return the first `count` eigenvectors with canonical signs and bases of repeated eigenvalues.

    The sign of an eigenvector makes the sum of its cubes positive. That sum is 0 for an odd function on a
    symmetric shape, and a repeated eigenvalue leaves the basis of its eigenspace free. In both cases the rows
    decide: the first row that is large in the eigenspace gives the first basis vector, the next row that is
    large in the orthogonal complement gives the second, and so on.

    The eigenvalues, shape (s,), are sorted; the eigenvectors are columns, shape (m, s), with s > count if the
    eigenvalues `count` and `count + 1` may be equal. The result has the shape (m, count).
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
