"""Class probability from two experts: intrinsic and extrinsic similarity.

Two shapes are of one class because one is the other in another pose (CC, eigenvalues, spin images), or
because they look alike from outside (views). Each expert gives log odds that are linear in logarithms of
differences. The log odds of a pair are the mean of both experts', weighted by the reliability of the pair's
intrinsic description: a logarithmic opinion pool (C. Genest, J. V. Zidek, "Combining probability
distributions", Statistical Science 1, 1986).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from core.arrays import Floats
from core.descriptors.registry import descriptors_of
from core.embedding import Embedding, Scores
from core.ranking.differences import PairDifferences, differences_of
from core.ranking.local_density import LocalDensities

GATE = 0.05
"""Spectral distance (root mean square difference of log eigenvalues) at which other differences count half.
Below it the surfaces are nearly isometric: poses of one body differ in the map that matching finds, in their
hull and in their views, and not in their eigenvalues."""

FLOORS = (0.01, 0.05, 0.1, 0.05, 0.05)
"""Added before logarithms of 1 - CC, 1 - sim, and of the differences of global descriptors, spin images and
views. Smaller differences occur between meshes of one shape."""

FINEST, FINE = 0.002, 0.05
"""The eigenvalues of nearly isometric surfaces tell individuals apart down to the spectral distance `FINEST`;
beyond `FINE` the other features do."""

LEAST_SPECTRAL_DENSITY, LEAST_VIEW_DENSITY = 0.02, 0.6
"""Smaller distances to the seventh neighbour count as these: many stored copies of a shape would make its
poses unlikely otherwise."""

SPECTRAL_FLOOR, PART_FLOOR = 0.03, 0.05
"""Added to a spectral distance and to the descriptor distance of a part before their logarithms."""


@dataclass(frozen=True)
class Calibration:
    """A logistic model: probability = 1 / (1 + exp(-(intercept + slopes . features))).

    Attributes
    ----------
    intercept : float
    slopes : tuple of float
        One for each feature. All are negative: a larger difference makes one class less likely.
    """

    intercept: float
    slopes: tuple[float, ...]

    def log_odds(self, features: Floats) -> Floats:
        """Return log odds of one class, shape (...), of features, shape (..., p)."""
        return np.asarray(self.intercept + (features * np.array(self.slopes)).sum(axis=-1))

    def class_probability(self, features: Floats, offset: Floats | float = 0.0) -> Floats:
        """Return class probabilities in [0, 1], shape (...), of features, shape (..., p).

        The offset, shape (...), is added to the log odds; it is no part of the fit.
        """
        return np.asarray(expit(self.log_odds(features) + offset))


CALIBRATED_POOL = Calibration(
    intercept=3.6626,
    slopes=(
        *(-1.7913, -2.3199, -0.8079, -0.9771, -7.4987),
        *(-5.0388, 1.6454, 0.3498, 0.5103, 0.9462, -5.5943),
        *(11.5248, 12.4606, 5.3758),
    ),
)
CALIBRATED_PARTS = Calibration(
    intercept=-0.3042,
    slopes=(
        *(-3.1737, -0.6561, -5.7893, -0.5111, -1.4805, -5.8213, 0.4985),
        *(-2.3657, 3.0283, 0.1236, 1.1437, 0.3922, 2.3248, -7.9636, -1.1560),
        21.0079,
    ),
)
"""The models of pairs of complete surfaces and of pairs with an incomplete surface.
`isoshape calibrate psb shrec11 webmodels` fitted them; docs/results.md has their errors."""

PART_FEATURES = 16
"""Number of features of pairs with an incomplete surface."""


def features(differences: PairDifferences) -> Floats:
    """Compute features of the pairs, shape (..., 14), linear in the log odds of both experts.

    With R the reliability and the weight w = 1 - R GATE^3 / (s^3 + GATE^3) of the spectral distance s, the
    first five are log(w d + floor) of each difference d of `FLOORS`. Then follow 1 - R, its products with the
    first five, and the logarithms of the densities, by views for both kinds of shapes and by eigenvalues for
    reliable ones.
    """
    s, reliability = differences.spectral, differences.reliability
    weight = 1.0 - reliability * GATE**3 / (s**3 + GATE**3)
    logs = _logs(differences, weight)
    soup = 1.0 - reliability
    views = _log_view_density(differences)
    spectral = np.log(np.maximum(differences.spectral_density, LEAST_SPECTRAL_DENSITY) + SPECTRAL_FLOOR)
    densities = [reliability * views, soup * views, reliability * spectral]
    return np.stack([*logs, soup, *(soup * each for each in logs), *densities], axis=-1)


def part_features(differences: PairDifferences) -> Floats:
    """Compute features of pairs with an incomplete surface, shape (..., PART_FEATURES).

    First log(part_distance + floor); then those of `features` with weight 1, with log(s + SPECTRAL_FLOOR)
    beside the differences, and of the densities that of the views alone.
    """
    logs = [
        np.log(differences.part_distance + PART_FLOOR),
        *_logs(differences, 1.0),
        np.log(differences.spectral + SPECTRAL_FLOOR),
    ]
    soup = 1.0 - differences.reliability
    return np.stack([*logs, soup, *(soup * each for each in logs), _log_view_density(differences)], axis=-1)


def _log_view_density(differences: PairDifferences) -> Floats:
    return np.asarray(np.log(np.maximum(differences.view_density, LEAST_VIEW_DENSITY)))


def _logs(differences: PairDifferences, weight: Floats | float) -> list[Floats]:
    """Return log(weight d + floor) of each difference d of `FLOORS`."""
    values = (
        np.maximum(1.0 - differences.cc, 0.0),
        1.0 - differences.sim,
        differences.global_distance,
        differences.distances["spin_images"],
        differences.distances["views"],
    )
    return [np.log(weight * difference + floor) for difference, floor in zip(values, FLOORS, strict=True)]


def isometry_bonus(differences: PairDifferences) -> Floats:
    """Return the bonus to the log odds of nearly isometric surfaces, shape (...): 0 to 3.3, not fitted.

    The nearer the eigenvalues, the larger the bonus. Collections of classes cannot show it, since all nearly
    isometric surfaces are of one class there.
    """
    s = differences.spectral
    return np.asarray(-differences.reliability * np.log((s + FINEST) / (s + FINE)))


def pooled_log_odds(differences: PairDifferences) -> Floats:
    """Compute log odds that pairs are of one class, shape (...). Probabilities saturate; they do not."""
    return np.where(
        differences.part,
        CALIBRATED_PARTS.log_odds(part_features(differences)),
        CALIBRATED_POOL.log_odds(features(differences)) + isometry_bonus(differences),
    )


def pooled_probability(differences: PairDifferences) -> Floats:
    """Compute class probabilities of pairs of surfaces, shape (...), in [0, 1]."""
    return np.asarray(expit(pooled_log_odds(differences)))


def combined_scores(
    query: Embedding,
    others: Sequence[Embedding],
    scores: Scores,
    query_density: LocalDensities | None = None,
    densities: LocalDensities | None = None,
) -> Floats:
    """Return the probability that an embedding and each of c others are of one class, shape (c,), in [0, 1].

    Calibrated for the default setting; under other parameters only its order has a meaning. Scores and
    densities are those of `core.ranking.differences.differences_of`.
    """
    described = [descriptors_of(other) for other in others]
    return pooled_probability(
        differences_of(descriptors_of(query), described, scores, query_density, densities)
    )
