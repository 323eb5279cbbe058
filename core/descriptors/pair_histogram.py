"""Histogram over pairs of oriented points: it needs no frame, and no signs of the normals.

E. Wahl, U. Hillenbrand, G. Hirzinger, "Surflet-pair-relation histograms: a statistical 3D-shape
representation for rapid classification", 3DIM 2003; here with the magnitudes of cosines, so that any
orientation of the faces gives the same histogram.
"""

import numpy as np

from core.arrays import Floats
from core.numerics.compilation import compiled, constant

ORIENTED_POINTS = 4096
"""Number of points; a power of two."""

DISTANCE_BINS, NORMAL_BINS, ANGLE_BINS = 12, 4, 5
"""Bins over the distance, over the cosine between the normals, and over that of a normal with the line."""

ANGLE_PAIRS = ANGLE_BINS * (ANGLE_BINS + 1) // 2
"""Bins over the two cosines with the line, the larger first."""

LONGEST = 4.0
"""Distances above this number of root mean square radii count in the last bin."""

PARTNERS = 16
"""Number of other points with which each point is paired."""


def pair_histogram(points: Floats, normals: Floats) -> Floats:
    """Shares of point pairs, shape (DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS), of sum 1.

    Parameters
    ----------
    points : float64, shape (ORIENTED_POINTS, 3)
        Sample points, evenly spread by area, at a root mean square radius of 1.
    normals : float64, shape (ORIENTED_POINTS, 3)
        Unit normals at the points, of either sign.
    """
    counts = _pair_counts(constant(points), constant(normals))
    return np.asarray(counts / counts.sum())


@compiled
def _pair_counts(points: Floats, normals: Floats) -> Floats:
    """Counts of the pairs (i, q i + r mod n): with q odd, each partner r pairs every point once."""
    counts = np.zeros((DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS))
    total = len(points)
    for partner in range(PARTNERS):
        factor, shift = 4 * (37 * partner + 11) + 1, 253 * partner + 127
        for first in range(total):
            second = (factor * first + shift) % total
            x = points[second, 0] - points[first, 0]
            y = points[second, 1] - points[first, 1]
            z = points[second, 2] - points[first, 2]
            distance = np.sqrt(x * x + y * y + z * z)
            scale = 1.0 / distance if distance > 0.0 else 0.0
            one = abs(normals[first, 0] * x + normals[first, 1] * y + normals[first, 2] * z) * scale
            other = abs(normals[second, 0] * x + normals[second, 1] * y + normals[second, 2] * z) * scale
            between = abs(
                normals[first, 0] * normals[second, 0]
                + normals[first, 1] * normals[second, 1]
                + normals[first, 2] * normals[second, 2]
            )
            i = min(int(distance * (DISTANCE_BINS / LONGEST)), DISTANCE_BINS - 1)
            j = min(int(between * NORMAL_BINS), NORMAL_BINS - 1)
            larger = min(int(max(one, other) * ANGLE_BINS), ANGLE_BINS - 1)
            smaller = min(int(min(one, other) * ANGLE_BINS), ANGLE_BINS - 1)
            counts[i, j, larger * (larger + 1) // 2 + smaller] += 1.0
    return counts
