"""SSD, CC and sim of matched points (Eqs. 18-20)."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats

EFFECTIVE = 0.05
"""gamma over the mean of the two clouds' mean radii (below Eq. 19)."""


def correlation(first: Floats, second: Floats) -> float:
    """Return CC of paired points, both of shape (p, k): in [-1, 1].

    Eq. 19 in print divides by the SSD's sum, so it is unbounded, and undefined for a perfect match. This is
    the correlation coefficient: the centred cross-sum over the root of the product of the two centred square
    sums. Clouds that are one point have none; they count 0.
    """
    x, y = first - first.mean(axis=0), second - second.mean(axis=0)
    size = float(np.sqrt((x**2).sum() * (y**2).sum()))
    return float(np.clip((x * y).sum() / size, -1.0, 1.0)) if size > 0.0 else 0.0


def squared_difference(first: Floats, second: Floats) -> float:
    """Return SSD of paired points, both of shape (p, k) (Eq. 18), >= 0.

    The root of the sum of squared differences of their coordinates, divided by the number of pairs.
    """
    return float(np.sqrt(((first - second) ** 2).sum()) / len(first))


def effective_distance(first: Floats, second: Floats) -> float:
    """Return gamma, 0.05 times the mean of the two clouds' mean distances from their centroids."""
    radii = [float(np.linalg.norm(cloud - cloud.mean(axis=0), axis=1).mean()) for cloud in (first, second)]
    return EFFECTIVE * 0.5 * (radii[0] + radii[1])


def effective_pairs(distances: Floats, matches: NDArray[np.int64], gamma: float) -> NDArray[np.bool_]:
    """Return a mask of the pairs within gamma; each target counts for its nearest point alone, shape (p,).

    Eq. 20 counts pairs on one side and divides by min(m, n), so many-to-one pairs could take it past 1.
    """
    near = distances <= gamma
    order = np.lexsort((distances, matches))
    first = np.zeros(len(matches), dtype=bool)
    first[order[np.unique(matches[order], return_index=True)[1]]] = True
    return np.asarray(near & first)
