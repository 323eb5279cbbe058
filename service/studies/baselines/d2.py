"""D2, the shape distribution of distances between pairs of points of a surface.

R. Osada, T. Funkhouser, B. Chazelle, D. Dobkin, "Shape distributions", ACM Transactions on Graphics 21(4),
2002.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.sampling.surface_samples import evenly_spread

Floats = NDArray[np.float64]

POINTS = 1024
"""Number of points, evenly spread by area; all their pairs, half a million, are measured."""

BINS, RANGE = 64, 3.0
"""Number of bins of the histogram, and its range in units of the mean distance."""


def describe(mesh: Mesh) -> Floats:
    """The share of the distances in each bin, shape (BINS,); the sum is at most 1.

    Distances are divided by their mean, so the size of the shape does not matter.

    Raises
    ------
    DegenerateMeshError
        The mesh has no area.
    """
    surface = clean(mesh).mesh
    areas = face_areas(surface.vertices, surface.faces)
    points, _ = evenly_spread(surface.vertices[surface.faces], areas, POINTS)
    lengths = pdist(points)
    counts, _ = np.histogram(lengths / lengths.mean(), bins=BINS, range=(0.0, RANGE))
    return np.asarray(counts / len(lengths))


def compare(description: Floats, others: Sequence[Floats]) -> Floats:
    """L1 distances between histograms, shape (c,), in [0, 2]."""
    return np.array([np.abs(description - other).sum() for other in others])
