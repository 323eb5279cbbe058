"""Robustness of samples: a surface under noise, and one body in several poses (Fig. 3c)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtri

from core.arrays import Floats, Ints
from core.graph.geodesics import farthest_points
from core.mesh.mesh import Mesh
from core.sampling.sampling import keyed_uniform
from core.studies.sampling.measures import distance_histogram, region_shares, total_variation
from core.studies.sampling.surface import METHODS, SamplingMethod, Surface

DELTAS = (0.0015, 0.005, 0.01)
ROBUST_TAU = 0.3
REGIONS = 50
"""Number of regions of about equal size in which samples are counted."""

_LEAST = 1e-12
"""Least distance of uniform numbers from 0 and 1, where the normal quantile is infinite."""


@dataclass(frozen=True)
class NoiseSensitivity:
    """Sensitivity of one method's samples to noise.

    Attributes
    ----------
    method : str
    delta : float
        Standard deviation of the noise of each coordinate, over the shape's size (`size_of`).
    histogram_change : float
        Total variation distance between the histograms of clean and noisy samples.
    overlap : float
        Share of the samples in the same regions with and without noise: 1 minus the total variation distance
        between the distributions of samples over `REGIONS` regions.
    even_overlap : float
        The overlap of the clean samples with samples spread evenly by area: the value of a selection without
        any preference.
    """

    method: str
    delta: float
    histogram_change: float
    overlap: float
    even_overlap: float


def size_of(surface: Surface) -> float:
    """Diagonal of the bounding box along the axes of the normal frame, in file units."""
    corners = np.ptp(surface.frame.apply(surface.cleaned.vertices), axis=0)
    return float(np.linalg.norm(corners)) * surface.frame.scale


def noisy(surface: Surface, delta: float, seed: int = 0) -> Surface:
    """The surface of the cleaned mesh with Gaussian noise of `delta` times its size on each coordinate.

    The noise depends on the position of a vertex, as in `core.sampling.sampling.keyed_uniform`, and scales
    with delta.
    """
    vertices = surface.cleaned.vertices
    places = surface.frame.apply(vertices)
    uniform = np.stack([keyed_uniform(places, 3 * seed + axis) for axis in range(3)], axis=1)
    shift = delta * size_of(surface) * ndtri(np.clip(uniform, _LEAST, 1.0 - _LEAST))
    return Surface.of(Mesh(vertices + shift, surface.cleaned.faces))


def regions_of(surface: Surface, count: int = REGIONS) -> Ints:
    """The region of each vertex, shape (n,): the nearest of `count` points by farthest-point selection."""
    first = int(np.argmax((surface.mesh.vertices**2).sum(axis=1)))
    centres = farthest_points(surface.graph, count, first)
    return np.asarray(np.argmin(surface.distances[centres], axis=0), dtype=np.int64)


def unrest(
    surface: Surface, samples: Mapping[SamplingMethod, Ints], disturbed: Surface, delta: float
) -> list[NoiseSensitivity]:
    """Noise sensitivity of each method, with as many samples of the noisy surface."""
    regions = regions_of(surface)
    even = np.bincount(regions, weights=surface.areas, minlength=REGIONS) / surface.areas.sum()
    home = cKDTree(surface.mesh.vertices)
    found = []
    for method, clean in samples.items():
        again = disturbed.select(method, min(len(clean), len(disturbed.mesh.vertices)))
        places = disturbed.frame.invert(disturbed.mesh.vertices[again])
        vertices = np.asarray(home.query(surface.frame.apply(places))[1])
        before = region_shares(regions, clean, REGIONS)
        after = region_shares(regions, vertices, REGIONS)
        change = total_variation(
            distance_histogram(surface.between(clean)), distance_histogram(disturbed.between(again))
        )
        found.append(
            NoiseSensitivity(
                method=method.name,
                delta=delta,
                histogram_change=change,
                overlap=1.0 - total_variation(before, after),
                even_overlap=1.0 - total_variation(before, even),
            )
        )
    return found


def robust_histograms(surface: Surface) -> dict[str, Floats]:
    """Histogram of each method at `ROBUST_TAU`, shape (BINS,)."""
    count = surface.count(ROBUST_TAU)
    return {
        method.name: distance_histogram(surface.between(surface.select(method, count))) for method in METHODS
    }


def pair_variations(histograms: Sequence[Mapping[str, Floats]], method: str) -> Floats:
    """Total variation distance between all pairs of surfaces under one method, shape (s (s - 1) / 2,)."""
    return np.array([total_variation(a[method], b[method]) for a, b in combinations(histograms, 2)])
