"""Class probability from two experts: intrinsic and extrinsic similarity.

Two shapes are of one class because one is the other in another pose (CC, eigenvalues, spin images), or
because they look alike from outside (views). Each expert gives log odds that are linear in logarithms of
differences. The log odds of a pair are the mean of both experts', weighted by the reliability of the pair's
intrinsic description: a logarithmic opinion pool (C. Genest, J. V. Zidek, "Combining probability
distributions", Statistical Science 1, 1986).

Views that a network sees count where both shapes have them; pairs without have models of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from core.arrays import Floats
from core.descriptors.registry import descriptors_of
from core.embedding import Embedding, Scores
from core.ranking.differences import PairDifferences, differences_of
from core.ranking.local_density import TYPICAL_NETWORK, TYPICAL_SPECTRAL, TYPICAL_VIEW, LocalDensities

GATE, STEEPNESS = 0.05, 6
"""Distance of eigenvalues, the geometric mean of that of many and that of signatures, at which other
differences and densities count half, and the power by which they fade below it. There the surfaces are nearly
isometric: poses of one body differ in the map that matching finds, in their hull and in their views, and not
in their eigenvalues."""

FLOORS = (0.01, 0.05, 0.1, 0.05, 0.05)
"""Added before logarithms of 1 - CC, 1 - sim, and of the differences of global descriptors, spin images and
views. Smaller differences occur between meshes of one shape."""

FINEST, FINE = 0.002, 0.05
"""The eigenvalues of nearly isometric surfaces tell individuals apart down to the distance `FINEST`; beyond
`FINE` the other features do."""

BONUS = 2.0
"""Weight of the logarithm of their ratio in the log odds."""

NETWORK_FLOOR = 0.05
"""Added to a distance between views that a network sees, before its logarithm."""

LEAST_NETWORK_DENSITY = 0.05
"""As `LEAST_VIEW_DENSITY`, for views that a network sees."""

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
        One for each feature.
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


CALIBRATED_PLAIN_POOL = Calibration(
    intercept=-8.9807,
    slopes=(
        *(-1.8553, -2.1277, -0.7838, -1.0365, -7.2603, 3.5964),
        *(1.5461, 0.0210, 0.4789, 1.1249, -5.8744, 11.4026),
        *(12.5416, 4.9272),
    ),
)
CALIBRATED_PLAIN_PARTS = Calibration(
    intercept=-5.9559,
    slopes=(
        *(-3.1833, -0.5886, -6.0314, -0.5023, -1.5061, -5.8242),
        *(0.5190, -2.5064, 3.0385, 0.0211, 1.5903, 0.3745),
        *(2.3527, -7.9590, -1.1952, 21.0485),
    ),
)
CALIBRATED_POOL = Calibration(
    intercept=-12.9030,
    slopes=(
        *(-1.5172, -1.9436, -0.8082, -0.3461, -0.5358, 5.2526),
        *(1.2629, -0.1560, 0.5475, 0.4333, -9.0414, 4.3921),
        *(11.5801, 4.6732, -9.6465, 4.1122, 7.7715, -4.3345),
    ),
)
CALIBRATED_PARTS = Calibration(
    intercept=-13.6313,
    slopes=(
        *(-3.2751, 0.1260, -5.7285, -0.7107, -0.6465, -0.1697),
        *(0.9926, 2.2297, 3.6905, -1.3400, 2.9565, 0.6746),
        *(1.4064, -6.3864, -2.0133, 9.3324, -14.5248, 8.2893),
        *(29.5616, -27.2540),
    ),
)
"""The models of pairs of complete surfaces and of pairs with an incomplete surface, with the views that a
network sees and, plain, without. `isoshape calibrate psb shrec11 webmodels` fitted them; docs/results.md has
their errors."""

PART_FEATURES, NETWORK_FEATURES = 16, 4
"""Numbers of features of pairs with an incomplete surface, and of those of the views that a network sees."""


def features(differences: PairDifferences, *, network: bool = False) -> Floats:
    """Compute features of the pairs, shape (..., 14) or (..., 18), linear in the log odds of both experts.

    With R the reliability and the weight w = 1 - R GATE^6 / (x^6 + GATE^6) of the distance x of eigenvalues,
    the first five are log(w d + floor) of each difference d of `FLOORS`. Then follow 1 - R, its products with
    the first five, and the logarithms of the densities times w, by views for both kinds of shapes and by
    eigenvalues for reliable ones. With `network` follow those of the views that a network sees.
    """
    reliability, gate = differences.reliability, GATE**STEEPNESS
    eigenvalues = np.sqrt(_eigenvalue_distance(differences) * differences.spectral)
    weight = 1.0 - reliability * gate / (eigenvalues**STEEPNESS + gate)
    logs = _logs(differences, weight)
    soup = 1.0 - reliability
    views = weight * _log_view_density(differences)
    density = np.maximum(differences.spectral_density, LEAST_SPECTRAL_DENSITY)
    spectral = weight * np.log((density + SPECTRAL_FLOOR) / (TYPICAL_SPECTRAL + SPECTRAL_FLOOR))
    densities = [reliability * views, soup * views, reliability * spectral]
    seen = _network_features(differences, weight) if network else []
    return np.stack([*logs, soup, *(soup * each for each in logs), *densities, *seen], axis=-1)


def _network_features(differences: PairDifferences, weight: Floats | float) -> list[Floats]:
    """Return log(weight d + floor) of the distance d that a network sees, and the log density times weight.

    Each is followed by its product with 1 - R.
    """
    seen = np.log(weight * differences.distances["network_views"] + NETWORK_FLOOR)
    density = np.maximum(differences.network_density, LEAST_NETWORK_DENSITY)
    density = weight * np.log(density / TYPICAL_NETWORK)
    soup = 1.0 - differences.reliability
    return [seen, soup * seen, density, soup * density]


def part_features(differences: PairDifferences, *, network: bool = False) -> Floats:
    """Compute features of pairs with an incomplete surface, shape (..., PART_FEATURES).

    First log(part_distance + floor); then those of `features` with weight 1, with log(s + SPECTRAL_FLOOR)
    beside the differences, and of the densities that of the views alone. With `network`, NETWORK_FEATURES
    follow.
    """
    logs = [
        np.log(differences.part_distance + PART_FLOOR),
        *_logs(differences, 1.0),
        np.log(differences.spectral + SPECTRAL_FLOOR),
    ]
    soup = 1.0 - differences.reliability
    seen = _network_features(differences, 1.0) if network else []
    density = _log_view_density(differences)
    return np.stack([*logs, soup, *(soup * each for each in logs), density, *seen], axis=-1)


def _log_view_density(differences: PairDifferences) -> Floats:
    return np.asarray(np.log(np.maximum(differences.view_density, LEAST_VIEW_DENSITY) / TYPICAL_VIEW))


def _eigenvalue_distance(differences: PairDifferences) -> Floats:
    """Return the distance of many eigenvalues, shape (...), or of those of signatures where these lack."""
    many = differences.distances["eigenvalues"]
    return np.where(np.isnan(many), differences.spectral, many)


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
    """Return the bonus to the log odds of nearly isometric surfaces, shape (...): 0 to 6.5, not fitted.

    The nearer the eigenvalues, the larger the bonus. Collections of classes cannot show it, since all nearly
    isometric surfaces are of one class there.
    """
    distance = _eigenvalue_distance(differences)
    ratio = (distance + FINEST) / (distance + FINE)
    return np.asarray(-BONUS * differences.reliability * np.log(ratio))


def pooled_log_odds(differences: PairDifferences) -> Floats:
    """Compute log odds that pairs are of one class, shape (...). Probabilities saturate; they do not."""
    plain, seen = (
        np.where(
            differences.part,
            parts.log_odds(part_features(differences, network=network)),
            pool.log_odds(features(differences, network=network)) + isometry_bonus(differences),
        )
        for pool, parts, network in (
            (CALIBRATED_PLAIN_POOL, CALIBRATED_PLAIN_PARTS, False),
            (CALIBRATED_POOL, CALIBRATED_PARTS, True),
        )
    )
    return np.where(np.isnan(differences.distances["network_views"]), plain, seen)


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
