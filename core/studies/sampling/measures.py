"""Quality measures of the samples of a surface (section 3.2, Figs. 2 and 3)."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from core.arrays import Floats, Ints
from core.sampling.lewis_weights import orthonormal_basis, polynomial_basis

BINS = 5
"""Number of bins of the histogram of normalised geodesic distances (Fig. 3)."""


def distance_histogram(distances: Floats) -> Floats:
    """The paper's r: histogram of the pairwise distances over the largest one, in `BINS` equal bins.

    Parameters
    ----------
    distances : float64, shape (m, m)
        Distances between m >= 2 samples, symmetric, not all zero.

    Returns
    -------
    float64, shape (BINS,)
        Shares of the pairs, of sum 1. A bin includes its lower end, the last bin both ends.
    """
    pairs = distances[np.triu_indices(len(distances), 1)]
    counts, _ = np.histogram(pairs / pairs.max(), bins=BINS, range=(0.0, 1.0))
    return np.asarray(counts / len(pairs))


def total_variation(first: Floats, second: Floats) -> float:
    """Total variation distance: half the sum of absolute differences of two distributions, in [0, 1]."""
    return 0.5 * float(np.abs(first - second).sum())


def largest_variation(histograms: list[Floats]) -> float:
    """The largest total variation distance between two of the histograms; 0 for a single histogram."""
    return max((total_variation(a, b) for i, a in enumerate(histograms) for b in histograms[:i]), default=0.0)


def fit_residuals(points: Floats, degree: int) -> Floats:
    """Residuals z - f(x, y) of the least-squares polynomial (Eqs. 6-9), shape (n,).

    Parameters
    ----------
    points : float64, shape (n, 3)
        In the normal frame, in units of the root mean square radius.
    degree : int
        Degree of f, 1 to 12.
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
        Probability p with which each point was drawn, positive for the samples. Rows are then weighted by
        1 / p, as by the matrix S of Algorithm 1, and the expected fit is that of all points.
    """
    basis = orthonormal_basis(polynomial_basis(points[:, 0], points[:, 1], degree))
    rows, heights = basis[samples], points[samples, 2]
    if probability is not None:
        root = 1.0 / np.sqrt(probability[samples])
        rows, heights = rows * root[:, None], heights * root
    return np.asarray(points[:, 2] - basis @ np.linalg.lstsq(rows, heights, rcond=None)[0])


@dataclass(frozen=True)
class Coverage:
    """Coverage and spacing of samples, in units of the surface's scale.

    Attributes
    ----------
    largest_gap, mean_gap : float
        Largest and area-weighted mean distance from a vertex to its nearest sample.
    mean_spacing : float
        Mean distance from a sample to its nearest sample.
    evenness : float
        Smallest distance between two samples over `mean_spacing`, in [0, 1].
    """

    largest_gap: float
    mean_gap: float
    mean_spacing: float
    evenness: float


def coverage(distances: Floats, areas: Floats, samples: Ints) -> Coverage:
    """Coverage and spacing of m >= 2 samples.

    Parameters
    ----------
    distances : float64, shape (n, n)
        Geodesic distances between all vertices.
    areas : float64, shape (n,)
        Areas of the vertices.
    samples : int64, shape (m,)
    """
    gaps = distances[samples].min(axis=0)
    between = distances[np.ix_(samples, samples)]
    np.fill_diagonal(between, np.inf)
    nearest = between.min(axis=1)
    return Coverage(
        largest_gap=float(gaps.max()),
        mean_gap=float(areas @ gaps / areas.sum()),
        mean_spacing=float(nearest.mean()),
        evenness=float(nearest.min() / nearest.mean()),
    )


def rebuilt(stiffness: csc_array, points: Floats, samples: Ints) -> Floats:
    """The harmonic surface through the samples: samples are fixed, other vertices minimise Dirichlet energy.

    Planar parts are reproduced exactly; curved parts between samples are cut off, as by simplification of the
    mesh to the samples.

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
    """Area-weighted root mean square distance between the vertices and their positions by `rebuilt`."""
    squares = ((rebuilt(stiffness, points, samples) - points) ** 2).sum(axis=1)
    return float(np.sqrt(areas @ squares / areas.sum()))


def region_shares(regions: Ints, samples: Ints, count: int) -> Floats:
    """Share of the samples in each of `count` regions, shape (count,), given the vertices' regions, (n,)."""
    return np.asarray(np.bincount(regions[samples], minlength=count) / len(samples))
