"""`combined`: all that is known of two shapes in one number, the chance that they are of one class."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core.arrays import Floats
from core.descriptors.descriptor_distance import DescriptorDistance
from core.descriptors.global_descriptors import GLOBAL_DESCRIPTORS, GLOBAL_WEIGHT

HALF_SATURATION = 0.1
"""Spectra whose logarithms differ by so much, root mean square, tell as much for one shape as against it."""

SIM_WEIGHT = 0.03
"""What sim counts beside CC: it falls from 1 some thirty times as fast between shapes of one class."""

WHOLE_WEIGHT = 0.2
"""What the match of the whole shapes counts beside their patches, where one is a part of the other: of the
whole, a small cut leaves most points that correspond, and a large one few."""

PAIRS_FLOOR, GLOBAL_FLOOR, SPIN_IMAGE_FLOOR = 0.03, 0.1, 0.05
"""Added before logarithms are taken: smaller differences are those of one body's poses and meshes."""


@dataclass(frozen=True)
class Calibration:
    """A logistic model: chance = 1 / (1 + exp(-(intercept + slopes . evidence))).

    Attributes
    ----------
    intercept : float
    slopes : tuple of float
        One a column of `evidence`. Below 0: what differs more is less likely of one class.
    """

    intercept: float
    slopes: tuple[float, ...]

    def class_probability(self, features: Floats) -> Floats:
        """From evidence, shape (..., p), to numbers in [0, 1], shape (...)."""
        return np.asarray(expit(self.intercept + (features * np.array(self.slopes)).sum(axis=-1)))


CALIBRATED = Calibration(intercept=-13.8067, slopes=(-4.9825, -0.2797, -2.7157))
CALIBRATED_PARTS = Calibration(intercept=-3.1062, slopes=(-5.8367,))
WITHOUT_SPIN_IMAGES = Calibration(intercept=-16.4318, slopes=(-4.9656, -0.9755))
"""Of two complete surfaces, of pairs with an incomplete one, and where patches are not known. By
`isoshape calibrate psb shrec11`, on every second model of each: see docs/calibration.md."""


def class_probability(whole: Floats, descriptor_distance: DescriptorDistance | None) -> Floats:
    """The chance of one class of c pairs, shape (c,), from the evidence of their match, shape (c, 2)."""
    if descriptor_distance is None:
        return WITHOUT_SPIN_IMAGES.class_probability(whole)
    return np.where(
        descriptor_distance.part,
        CALIBRATED_PARTS.class_probability(part_features(whole, descriptor_distance.distance)),
        CALIBRATED.class_probability(spin_image_features(whole, descriptor_distance.distance)),
    )


def spin_image_features(whole: Floats, distance: Floats) -> Floats:
    """`evidence`, shape (..., 2), and the logarithm of the distance of patches, shape (...): (..., 3)."""
    return np.concatenate([whole, np.log(distance + SPIN_IMAGE_FLOOR)[..., None]], axis=-1)


def part_features(whole: Floats, distance: Floats) -> Floats:
    """The same where one is a part of the other, shape (..., 1)."""
    return (np.log(distance + SPIN_IMAGE_FLOOR) + WHOLE_WEIGHT * whole[..., 0])[..., None]


def features(cc: Floats, sim: Floats, spectral: Floats, form: Floats) -> Floats:
    """What speaks against one class, as logarithms; arrays of one shape in, that shape and (2,) behind out.

    The nearer the spectra are, the less all else counts. f = s^2 / (s^2 + HALF_SATURATION^2) rises with the spectral
    distance s from 0 to 1; with d the distance of form, the columns are
    log(f (1 - cc + SIM_WEIGHT (1 - sim)) + PAIRS_FLOOR) and log(f d + FAINT_FORM). Poses of one body have
    nearly equal spectra, while their correspondence may stray, and how much of its hull a body fills hangs
    on its pose.

    Parameters
    ----------
    cc, sim : float64
        In [-1, 1] and [0, 1].
    spectral, form : float64
        Distances between the parts of two signatures, >= 0.
    """
    far = spectral**2 / (spectral**2 + HALF_SATURATION**2)
    return np.stack(
        [
            np.log(far * (1.0 - cc + SIM_WEIGHT * (1.0 - sim)) + PAIRS_FLOOR),
            np.log(far * form + GLOBAL_FLOOR),
        ],
        axis=-1,
    )


def signature_features(
    cc: Floats, sim: Floats, query: NDArray[np.float32], signatures: NDArray[np.float32], *, form: bool
) -> Floats:
    """`evidence` of one shape against c others, shape (c, 2).

    Parameters
    ----------
    cc, sim : float64, shape (c,)
    query : float32, shape (s,)
    signatures : float32, shape (c, s)
        Eigenvalues first, and with `form` the terms of form behind, as `core.spectral.spectral_embedding` puts them.
    """
    steps = np.asarray(signatures, dtype=np.float64) - np.asarray(query, dtype=np.float64)
    values = steps.shape[1] - GLOBAL_DESCRIPTORS if form else steps.shape[1]
    spectral = np.linalg.norm(steps[:, :values], axis=1)
    return features(cc, sim, spectral, np.linalg.norm(steps[:, values:], axis=1) / GLOBAL_WEIGHT)
