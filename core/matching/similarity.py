"""SSD, CC and sim of matched points (Eqs. 18-20), and the match of one pair of shapes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints

EFFECTIVE = 0.05
"""gamma over the mean of the two clouds' mean radii (below Eq. 19)."""


@dataclass(frozen=True, eq=False)
class PairMatch:
    """The match of one pair of shapes.

    Attributes
    ----------
    cc, ssd, sim : float
        As in `core.embedding.Scores`.
    pairs : int64, shape (p, 2)
        Pairs (sample of the first shape, sample of the second).
    distances : float64, shape (p,)
    effective : bool, shape (p,)
        As in `core.embedding.Match`.
    mirrored : bool or None
        As in `core.embedding.Match`.
    """

    cc: float
    ssd: float
    sim: float
    pairs: Ints
    distances: Floats
    effective: NDArray[np.bool_]
    mirrored: bool | None = None

    def swapped(self) -> "PairMatch":
        """Return the same match seen from the other shape."""
        order = np.lexsort((self.pairs[:, 0], self.pairs[:, 1]))
        return replace(
            self,
            pairs=self.pairs[order][:, ::-1],
            distances=self.distances[order],
            effective=self.effective[order],
        )


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
    """Return SSD of paired points (Eq. 18), >= 0.

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
