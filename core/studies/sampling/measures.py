"""Numbers that tell how good a sampling of a surface is (section 3.2, Figs. 2 and 3)."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from core.arrays import Floats, Ints
from core.sampling.lewis_weights import orthonormal_basis, polynomial_basis

BINS = 5
"""Ranges of the histogram of normalised geodesic distances (Fig. 3)."""


def distance_histogram(distances: Floats) -> Floats:
    """The paper's r: shares of all pairs by their distance over the largest, in five ranges of equal width.

    Parameters
    ----------
    distances : float64, shape (m, m)
        Between m >= 2 samples, symmetric, not all zero.

    Returns
    -------
    float64, shape (5,)
        Summing to 1; a range holds its lower end, the last one both.
    """
    pairs = distances[np.triu_indices(len(distances), 1)]
    counts, _ = np.histogram(pairs / pairs.max(), bins=BINS, range=(0.0, 1.0))
    return np.asarray(counts / len(pairs))


def total_variation(first: Floats, second: Floats) -> float:
    """Half the sum of absolute differences of two distributions: 0 when equal, 1 when they share nothing."""
    return 0.5 * float(np.abs(first - second).sum())


def largest_variation(histograms: list[Floats]) -> float:
    """The largest total variation distance between any two of them; 0 for a single one."""
    return max((total_variation(a, b) for i, a in enumerate(histograms) for b in histograms[:i]), default=0.0)


def fit_residuals(points: Floats, degree: int) -> Floats:
    """Residuals z - f(x, y) of the best fit of a degree to points of the normal frame (Eqs. 6-9).

    Shape (n,), in units of the shape's scale, its root mean square radius.
    """
    basis = orthonormal_basis(polynomial_basis(points[:, 0], points[:, 1], degree))
    return np.asarray(points[:, 2] - basis @ (basis.T @ points[:, 2]))


def root_mean_square(values: Floats) -> float:
    """The root of the mean square of an array of shape (n,)."""
    return float(np.sqrt(np.mean(values**2)))


def sampled_fit_residuals(
    points: Floats, samples: Ints, degree: int, probability: Floats | None = None
) -> Floats:
    """Residuals z - f(x, y) at all points, where f is fitted to the samples alone, shape (n,).

    Parameters
    ----------
    points : float64, shape (n, 3)
        In the normal frame.
    samples : int64, shape (m,)
    degree : int
    probability : float64, shape (n,), optional
        With which each point was drawn, positive for the samples: rows then weigh 1 / p, as the matrix S of
        Algorithm 1 has them, and the fit is that of all points in expectation.
    """
    basis = orthonormal_basis(polynomial_basis(points[:, 0], points[:, 1], degree))
    rows, heights = basis[samples], points[samples, 2]
    if probability is not None:
        root = 1.0 / np.sqrt(probability[samples])
        rows, heights = rows * root[:, None], heights * root
    return np.asarray(points[:, 2] - basis @ np.linalg.lstsq(rows, heights, rcond=None)[0])


@dataclass(frozen=True)
class Spread:
    """How samples lie on a surface, in units of its scale.

    Attributes
    ----------
    largest_gap, mean_gap : float
        Distance from a vertex to its nearest sample: over all vertices the largest, and the mean by area.
    mean_spacing : float
        Mean distance from a sample to the next sample.
    evenness : float
        The smallest distance between two samples over `mean_spacing`, in [0, 1].
    """

    largest_gap: float
    mean_gap: float
    mean_spacing: float
    evenness: float


def spread(distances: Floats, areas: Floats, samples: Ints) -> Spread:
    """Coverage and spacing of m >= 2 samples.

    Parameters
    ----------
    distances : float64, shape (n, n)
        Between all vertices.
    areas : float64, shape (n,)
        Of the vertices.
    samples : int64, shape (m,)
    """
    gaps = distances[samples].min(axis=0)
    between = distances[np.ix_(samples, samples)]
    np.fill_diagonal(between, np.inf)
    nearest = between.min(axis=1)
    return Spread(
        largest_gap=float(gaps.max()),
        mean_gap=float(areas @ gaps / areas.sum()),
        mean_spacing=float(nearest.mean()),
        evenness=float(nearest.min() / nearest.mean()),
    )


def rebuilt(stiffness: csc_array, points: Floats, samples: Ints) -> Floats:
    """The surface stretched over its samples like a soap film: samples stay, the other vertices are harmonic.

    Flat parts come back exactly, and what lies between samples on a curved part is cut off, as when a mesh is
    simplified to the samples.

    Parameters
    ----------
    stiffness : csc_array, shape (n, n)
        Cotangent Laplacian of a connected surface.
    points : float64, shape (n, 3)
    samples : int64, shape (m,), m >= 1

    Returns
    -------
    float64, shape (n, 3)
    """
    free = np.ones(len(points), dtype=bool)
    free[samples] = False
    film = points.copy()
    if free.any():
        rows = csc_array(stiffness[free])
        film[free] = splu(csc_array(rows[:, free])).solve(-(rows[:, samples] @ points[samples]))
    return film


def rebuilt_error(stiffness: csc_array, areas: Floats, points: Floats, samples: Ints) -> float:
    """Root mean square distance by area between the vertices and where `rebuilt` puts them."""
    squares = ((rebuilt(stiffness, points, samples) - points) ** 2).sum(axis=1)
    return float(np.sqrt(areas @ squares / areas.sum()))


def region_shares(regions: Ints, samples: Ints, count: int) -> Floats:
    """Share of the samples in each of `count` regions, shape (count,), given the vertices' regions, (n,)."""
    return np.asarray(np.bincount(regions[samples], minlength=count) / len(samples))
