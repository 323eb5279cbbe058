"""Class probability (the score `combined`): a logistic model over the scores and distances of two shapes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core.arrays import Floats
from core.descriptors.descriptor_distance import DescriptorDistance
from core.ranking.spectral_distance import global_distances, spectral_distances

HALF_SATURATION = 0.1
"""Spectral distance (root mean square difference of log eigenvalues) at which the weight f is 1/2."""

SIM_WEIGHT = 0.03
"""Weight of 1 - sim beside 1 - CC: between shapes of one class, 1 - sim is about thirty times as large."""

WHOLE_WEIGHT = 0.2
"""Weight of the whole shapes' match beside their spin images, where one shape is a part of the other. After a
small cut most correspondences survive; after a large one few do."""

PAIRS_FLOOR, GLOBAL_FLOOR, SPIN_IMAGE_FLOOR = 0.03, 0.1, 0.05
"""Added before logarithms are taken. Smaller differences occur between poses and meshes of one body."""


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
        """Log odds of one class, shape (...), of features, shape (..., p)."""
        return np.asarray(self.intercept + (features * np.array(self.slopes)).sum(axis=-1))

    def class_probability(self, features: Floats, offset: Floats | float = 0.0) -> Floats:
        """Class probabilities in [0, 1], shape (...), of features, shape (..., p).

        The offset, shape (...), is added to the log odds; it is no part of the fit.
        """
        return np.asarray(expit(self.log_odds(features) + offset))


CALIBRATED = Calibration(intercept=-13.8067, slopes=(-4.9825, -0.2797, -2.7157))
CALIBRATED_PARTS = Calibration(intercept=-3.1062, slopes=(-5.8367,))
WITHOUT_SPIN_IMAGES = Calibration(intercept=-16.4318, slopes=(-4.9656, -0.9755))
"""The models of pairs of complete surfaces, of pairs with an incomplete surface, and of pairs without spin
images. They rank archives whose embeddings have no views. An earlier version of `isoshape calibrate` fitted
them to psb and shrec11, to every second model of each; the present one fits `core.ranking.opinion_pool`."""


def class_probability(whole: Floats, descriptor_distance: DescriptorDistance | None) -> Floats:
    """Probability that each of c pairs is of one class, shape (c,), in [0, 1].

    Parameters
    ----------
    whole : float64, shape (c, 2)
        `features` of the pairs.
    descriptor_distance : DescriptorDistance or None
        Of the c pairs; None where embeddings have no spin images.
    """
    if descriptor_distance is None:
        return WITHOUT_SPIN_IMAGES.class_probability(whole)
    return np.where(
        descriptor_distance.part,
        CALIBRATED_PARTS.class_probability(part_features(whole, descriptor_distance.distance)),
        CALIBRATED.class_probability(spin_image_features(whole, descriptor_distance.distance)),
    )


def spin_image_features(whole: Floats, distance: Floats) -> Floats:
    """Features of complete surfaces, shape (..., 3): those of the whole and the log descriptor distance.

    Parameters
    ----------
    whole : float64, shape (..., 2)
        `features` of the pairs.
    distance : float64, shape (...)
        Descriptor distances, >= 0.
    """
    return np.concatenate([whole, np.log(distance + SPIN_IMAGE_FLOOR)[..., None]], axis=-1)


def part_features(whole: Floats, distance: Floats) -> Floats:
    """The feature of pairs with an incomplete surface, shape (..., 1).

    Parameters
    ----------
    whole : float64, shape (..., 2)
        `features` of the pairs.
    distance : float64, shape (...)
        Descriptor distances, >= 0.
    """
    return (np.log(distance + SPIN_IMAGE_FLOOR) + WHOLE_WEIGHT * whole[..., 0])[..., None]


def features(cc: Floats, sim: Floats, spectral: Floats, global_distance: Floats) -> Floats:
    """Two features of the match of whole shapes, shape (..., 2); larger values speak against one class.

    With s the spectral distance, d the distance of global descriptors and the weight
    f = s^2 / (s^2 + HALF_SATURATION^2), which rises from 0 to 1, the features are
    log(f (1 - cc + SIM_WEIGHT (1 - sim)) + PAIRS_FLOOR) and log(f d + GLOBAL_FLOOR). The other differences
    count less where the spectra are close: two poses of one body have nearly equal spectra, while their
    correspondence may fail and their convex hulls differ.

    Parameters
    ----------
    cc, sim : float64, shape (...)
        In [-1, 1] and in [0, 1].
    spectral, global_distance : float64, shape (...)
        Distances between the eigenvalues and between the global descriptors of two signatures, >= 0.
    """
    weight = spectral**2 / (spectral**2 + HALF_SATURATION**2)
    return np.stack(
        [
            np.log(weight * (1.0 - cc + SIM_WEIGHT * (1.0 - sim)) + PAIRS_FLOOR),
            np.log(weight * global_distance + GLOBAL_FLOOR),
        ],
        axis=-1,
    )


def signature_features(
    cc: Floats,
    sim: Floats,
    query: NDArray[np.float32],
    signatures: NDArray[np.float32],
    *,
    global_descriptors: bool,
) -> Floats:
    """`features` of one shape with each of c others, shape (c, 2).

    Parameters
    ----------
    cc, sim : float64, shape (c,)
        In [-1, 1] and in [0, 1].
    query : float32, shape (s,)
        Signature of the shape.
    signatures : float32, shape (c, s)
        Signatures of the others: log eigenvalues, and with `global_descriptors` the global descriptors last.
    global_descriptors : bool
        Whether signatures end with global descriptors; their distances count as 0 otherwise.
    """
    spectral = spectral_distances(query, signatures, global_descriptors=global_descriptors)
    whole = global_distances(query, signatures) if global_descriptors else np.zeros(len(signatures))
    return features(cc, sim, spectral, whole)
