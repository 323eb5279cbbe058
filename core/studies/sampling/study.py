"""The sampling study: all trials on one shape, and on several."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats
from core.studies.sampling.measures import distance_histogram
from core.studies.sampling.robustness import (
    DELTAS,
    ROBUST_TAU,
    NoiseSensitivity,
    noisy,
    pair_variations,
    robust_histograms,
    unrest,
)
from core.studies.sampling.surface import METHODS, Surface
from core.studies.sampling.trials import (
    COMPARED_TAU,
    CURVE_TAUS,
    TAUS,
    Quality,
    Stability,
    fit_errors,
    plain,
    quality,
    select_all,
    steadiness,
)


@dataclass(frozen=True)
class ShapeMeasures:
    """All trials on one shape.

    Attributes
    ----------
    name : str
    vertices : int
        Number of vertices of the sampled surface.
    fit_errors : tuple of float
        Fit error for each of `core.studies.sampling.trials.DEGREES`.
    surface_histogram : tuple of float
        Histogram of the distances between all vertices.
    steadiness, quality, noise : tuple
        Results for each of `METHODS`; `noise` also for each of `DELTAS`.
    robust_histograms : dict
        Histograms by method, at `ROBUST_TAU`.
    """

    name: str
    vertices: int
    fit_errors: tuple[float, ...]
    surface_histogram: tuple[float, ...]
    steadiness: tuple[Stability, ...]
    quality: tuple[Quality, ...]
    noise: tuple[NoiseSensitivity, ...]
    robust_histograms: dict[str, tuple[float, ...]]


@dataclass(frozen=True)
class PoseMeasures:
    """Histograms of one body in one pose, by method, at `ROBUST_TAU`."""

    name: str
    robust_histograms: dict[str, tuple[float, ...]]


@dataclass(frozen=True)
class SamplingStudy:
    """Several shapes, and several poses of one body."""

    shapes: tuple[ShapeMeasures, ...]
    poses: tuple[PoseMeasures, ...]


def study_shape(name: str, surface: Surface) -> ShapeMeasures:
    """All trials on one surface; they take some seconds for the distances of all pairs, clean and noisy."""
    chosen = select_all(surface, sorted({COMPARED_TAU, ROBUST_TAU, *TAUS, *CURVE_TAUS}))
    robust = {method: samples[ROBUST_TAU] for method, samples in chosen.items()}
    return ShapeMeasures(
        name=name,
        vertices=len(surface.mesh.vertices),
        fit_errors=fit_errors(surface),
        surface_histogram=plain(distance_histogram(surface.distances)),
        steadiness=tuple(steadiness(surface, method, chosen[method]) for method in METHODS),
        quality=tuple(quality(surface, method, chosen[method]) for method in METHODS),
        noise=tuple(row for delta in DELTAS for row in unrest(surface, robust, noisy(surface, delta), delta)),
        robust_histograms={
            method.name: plain(distance_histogram(surface.between(samples)))
            for method, samples in robust.items()
        },
    )


def study_pose(name: str, surface: Surface) -> PoseMeasures:
    """The histograms of one pose."""
    found = robust_histograms(surface)
    return PoseMeasures(name, {method: plain(histogram) for method, histogram in found.items()})


def variations(shapes: Sequence[ShapeMeasures | PoseMeasures], method: str) -> Floats:
    """Total variation distance between the histograms of all pairs, shape (s (s - 1) / 2,)."""
    return pair_variations(
        [{name: np.array(shares) for name, shares in shape.robust_histograms.items()} for shape in shapes],
        method,
    )
