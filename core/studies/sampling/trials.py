"""Trials of the paper: degree of the fit (Fig. 2), sparse ratio (Fig. 3a), sampling methods (Fig. 3b)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.studies.sampling.measures import (
    coverage,
    distance_histogram,
    fit_residuals,
    largest_variation,
    rebuilt_error,
    root_mean_square,
    sampled_fit_residuals,
    total_variation,
)
from core.studies.sampling.surface import METHODS, STUDY_PARAMETERS, SamplingMethod, Surface

DEGREES = (4, 5, 6)
TAUS = (0.1, 0.2, 0.5)
COMPARED_TAU = 0.1
"""Sparse ratio for the comparison of methods: dense enough for every fit, sparse enough for differences."""

CURVE_TAUS = (0.05, 0.1, 0.2, 0.3, 0.5)
Samples = Mapping[SamplingMethod, Mapping[float, Ints]]


@dataclass(frozen=True)
class Stability:
    """Stability of one method over the sparse ratio (Fig. 3a).

    Attributes
    ----------
    histograms : tuple of tuples
        Histogram of normalised geodesic distances for each of `TAUS`.
    between_taus : float
        Largest total variation distance between two of the histograms.
    from_surface : float
        Mean total variation distance of the histograms from the histogram of all vertices.
    """

    method: str
    histograms: tuple[tuple[float, ...], ...]
    between_taus: float
    from_surface: float


@dataclass(frozen=True)
class Quality:
    """Quality of one method's samples at `COMPARED_TAU` (Fig. 3b); lengths are in units of the shape's scale.

    Attributes
    ----------
    largest_gap, mean_gap, mean_spacing, evenness : float
        As in `core.studies.sampling.measures.Coverage`.
    histogram : tuple of float
        Histogram of normalised geodesic distances.
    fit_error : float
        Root mean square residual at all vertices of the polynomial that is fitted to the samples.
    rebuilt_errors : tuple of float
        Error of the surface rebuilt from the samples, for each of `CURVE_TAUS`.
    """

    method: str
    samples: int
    largest_gap: float
    mean_gap: float
    mean_spacing: float
    evenness: float
    histogram: tuple[float, ...]
    fit_error: float
    rebuilt_errors: tuple[float, ...]


def select_all(surface: Surface, taus: Sequence[float]) -> Samples:
    """Samples of every method at each sparse ratio."""
    return {method: {tau: surface.select(method, surface.count(tau)) for tau in taus} for method in METHODS}


def fit_errors(surface: Surface) -> tuple[float, ...]:
    """Root mean square residual over the shape's scale, for each of `DEGREES` (Fig. 2)."""
    return tuple(root_mean_square(fit_residuals(surface.mesh.vertices, degree)) for degree in DEGREES)


def steadiness(surface: Surface, method: SamplingMethod, samples: Mapping[float, Ints]) -> Stability:
    """Fig. 3a for one method, from its samples at each of `TAUS`."""
    whole = distance_histogram(surface.distances)
    found = [distance_histogram(surface.between(samples[tau])) for tau in TAUS]
    return Stability(
        method=method.name,
        histograms=tuple(map(plain, found)),
        between_taus=largest_variation(found),
        from_surface=float(np.mean([total_variation(one, whole) for one in found])),
    )


def quality(surface: Surface, method: SamplingMethod, samples: Mapping[float, Ints]) -> Quality:
    """Fig. 3b for one method, from its samples at each of `CURVE_TAUS`."""
    points, areas, chosen = surface.mesh.vertices, surface.areas, samples[COMPARED_TAU]
    laid = coverage(surface.distances, areas, chosen)
    probability = surface.probability(method, len(chosen))
    return Quality(
        method=method.name,
        samples=len(chosen),
        largest_gap=laid.largest_gap,
        mean_gap=laid.mean_gap,
        mean_spacing=laid.mean_spacing,
        evenness=laid.evenness,
        histogram=plain(distance_histogram(surface.between(chosen))),
        fit_error=root_mean_square(
            sampled_fit_residuals(points, chosen, STUDY_PARAMETERS.sampling.degree, probability)
        ),
        rebuilt_errors=tuple(
            rebuilt_error(surface.stiffness, areas, points, samples[tau]) for tau in CURVE_TAUS
        ),
    )


def plain(values: Floats) -> tuple[float, ...]:
    """An array of shape (n,) as a tuple of Python floats."""
    return tuple(values.tolist())
