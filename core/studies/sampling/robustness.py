"""Samples of a surface under noise, and of one body in several poses (Fig. 3c)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtri

from core.arrays import Floats, Ints
from core.mesh.mesh import Mesh
from core.sampling.farthest_point import farthest_points
from core.sampling.sampling import keyed_uniform
from core.studies.sampling.measures import distance_histogram, region_shares, total_variation
from core.studies.sampling.surface import METHODS, Method, Surface

DELTAS = (0.0015, 0.005, 0.01)
ROBUST_TAU = 0.3
REGIONS = 50
"""The surface is cut into so many about equal regions, to see where the samples are."""

_LEAST = 1e-12
"""Uniform numbers are kept so far from 0 and 1, where the normal quantile is infinite."""


@dataclass(frozen=True)
class Unrest:
    """What noise does to one method's samples.

    Attributes
    ----------
    method : str
    delta : float
        Standard deviation of the noise of each coordinate, over the shape's size (`size_of`).
    histogram_change : float
        Total variation distance between the histograms of clean and noisy samples.
    overlap : float
        Share of the samples that lie in the same regions with and without noise: 1 less the total variation
        distance between their shares in `REGIONS` regions.
    even_overlap : float
        The same between the clean samples and an even spread by area: what a selection that had lost all its
        preference would still reach.
    """

    method: str
    delta: float
    histogram_change: float
    overlap: float
    even_overlap: float


def size_of(surface: Surface) -> float:
    """The shape's size, in file units: the diagonal of its bounding box along its normal frame's axes."""
    corners = np.ptp(surface.frame.apply(surface.cleaned.vertices), axis=0)
    return float(np.linalg.norm(corners)) * surface.frame.scale


def noisy(surface: Surface, delta: float, seed: int = 0) -> Surface:
    """The cleaned mesh with Gaussian noise of `delta` times its size on each coordinate, made ready anew.

    The noise is keyed to where a vertex is, like `core.sampling.sampling.keyed_uniform`, and larger with delta alone.
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
    surface: Surface, samples: Mapping[Method, Ints], disturbed: Surface, delta: float
) -> list[Unrest]:
    """What noise does to each method, as many samples being taken again from the noisy surface."""
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
            Unrest(
                method=method.name,
                delta=delta,
                histogram_change=change,
                overlap=1.0 - total_variation(before, after),
                even_overlap=1.0 - total_variation(before, even),
            )
        )
    return found


def robust_histograms(surface: Surface) -> dict[str, Floats]:
    """Each method's histogram at `ROBUST_TAU`, shape (5,)."""
    count = surface.count(ROBUST_TAU)
    return {
        method.name: distance_histogram(surface.between(surface.select(method, count))) for method in METHODS
    }


def pair_variations(histograms: Sequence[Mapping[str, Floats]], method: str) -> Floats:
    """Total variation distance between all pairs of surfaces under one method, shape (s (s - 1) / 2,)."""
    return np.array([total_variation(a[method], b[method]) for a, b in combinations(histograms, 2)])
