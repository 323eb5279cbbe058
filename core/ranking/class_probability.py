"""`combined`: all that is known of two shapes in one number, the chance that they are of one class."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core.arrays import Floats
from core.descriptors.descriptor_distance import Apart
from core.descriptors.global_descriptors import FORM_SHARE, TERMS

NEAR = 0.1
"""Spectra whose logarithms differ by so much, root mean square, tell as much for one shape as against it."""

SIM_SHARE = 0.03
"""What sim counts beside CC: it falls from 1 some thirty times as fast between shapes of one class."""

WHOLE_SHARE = 0.2
"""What the match of the whole shapes counts beside their patches, where one is a part of the other: of the
whole, a small cut leaves most points that correspond, and a large one few."""

FAINT_PAIRS, FAINT_FORM, FAINT_PATCHES = 0.03, 0.1, 0.05
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

    def chance(self, evidence: Floats) -> Floats:
        """From evidence, shape (..., p), to numbers in [0, 1], shape (...)."""
        return np.asarray(expit(self.intercept + (evidence * np.array(self.slopes)).sum(axis=-1)))


CALIBRATED = Calibration(intercept=-13.8067, slopes=(-4.9825, -0.2797, -2.7157))
CALIBRATED_PARTS = Calibration(intercept=-3.1062, slopes=(-5.8367,))
WITHOUT_PATCHES = Calibration(intercept=-16.4318, slopes=(-4.9656, -0.9755))
"""Of two complete surfaces, of pairs with an incomplete one, and where patches are not known. By
`isoshape calibrate psb shrec11`, on every second model of each: see docs/calibration.md."""


def chance(whole: Floats, apart: Apart | None) -> Floats:
    """The chance of one class of c pairs, shape (c,), from the evidence of their match, shape (c, 2)."""
    if apart is None:
        return WITHOUT_PATCHES.chance(whole)
    return np.where(
        apart.part,
        CALIBRATED_PARTS.chance(part_evidence(whole, apart.distance)),
        CALIBRATED.chance(patch_evidence(whole, apart.distance)),
    )


def patch_evidence(whole: Floats, distance: Floats) -> Floats:
    """`evidence`, shape (..., 2), and the logarithm of the distance of patches, shape (...): (..., 3)."""
    return np.concatenate([whole, np.log(distance + FAINT_PATCHES)[..., None]], axis=-1)


def part_evidence(whole: Floats, distance: Floats) -> Floats:
    """The same where one is a part of the other, shape (..., 1)."""
    return (np.log(distance + FAINT_PATCHES) + WHOLE_SHARE * whole[..., 0])[..., None]


def evidence(cc: Floats, sim: Floats, spectral: Floats, form: Floats) -> Floats:
    """What speaks against one class, as logarithms; arrays of one shape in, that shape and (2,) behind out.

    The nearer the spectra are, the less all else counts. f = s^2 / (s^2 + NEAR^2) rises with the spectral
    distance s from 0 to 1; with d the distance of form, the columns are
    log(f (1 - cc + SIM_SHARE (1 - sim)) + FAINT_PAIRS) and log(f d + FAINT_FORM). Poses of one body have
    nearly equal spectra, while their correspondence may stray, and how much of its hull a body fills hangs
    on its pose.

    Parameters
    ----------
    cc, sim : float64
        In [-1, 1] and [0, 1].
    spectral, form : float64
        Distances between the parts of two signatures, >= 0.
    """
    far = spectral**2 / (spectral**2 + NEAR**2)
    return np.stack(
        [
            np.log(far * (1.0 - cc + SIM_SHARE * (1.0 - sim)) + FAINT_PAIRS),
            np.log(far * form + FAINT_FORM),
        ],
        axis=-1,
    )


def signature_evidence(
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
    values = steps.shape[1] - TERMS if form else steps.shape[1]
    spectral = np.linalg.norm(steps[:, :values], axis=1)
    return evidence(cc, sim, spectral, np.linalg.norm(steps[:, values:], axis=1) / FORM_SHARE)
