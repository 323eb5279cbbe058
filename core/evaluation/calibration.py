"""Calibration of the class probability on labelled collections, and its reliability.

The model is a logistic regression over all pairs (Platt 1999). Every collection has the same weight, for any
size. The evaluation leaves one class out: a model that is fitted to the pairs without any shape of that class
judges the pairs of its shapes with all others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core.arrays import Floats
from core.errors import ParameterError
from core.ranking.class_probability import Calibration

PENALTY = 1e-5
"""Weight of the squared slopes of standardised features beside the mean loss: a fit exists also for separable
classes, and other fits hardly change."""

STEPS = 100
CONVERGED = 1e-9

BINS = 10


@dataclass(frozen=True, eq=False)
class LabelledPairs:
    """All pairs of n labelled shapes.

    Equal `labels` in two collections are one class; case does not matter. `features`, shape (n, n, p), are
    symmetric in the first two axes unless `asked` is given; the diagonal is not read. `asked`, shape (n, n),
    tells which pairs (i, j) exist, where i is a perturbed query and j a stored shape; all if absent.
    `offsets`, shape (n, n), are the part of the log odds that is not fitted, and `weight` > 0 that of all
    pairs together in a fit.
    """

    labels: tuple[str, ...]
    features: Floats
    asked: NDArray[np.bool_] | None = None
    offsets: Floats | None = None
    weight: float = 1.0

    @property
    def added(self) -> Floats:
        """The offsets, 0 unless given, shape (n, n)."""
        return np.zeros(self.features.shape[:2]) if self.offsets is None else self.offsets

    @property
    def codes(self) -> NDArray[np.str_]:
        """The class names, case-folded, shape (n,)."""
        return np.array([label.casefold() for label in self.labels])

    @property
    def both_ways(self) -> NDArray[np.bool_]:
        """Mask of the pairs, in both directions if the features are symmetric, shape (n, n)."""
        others = ~np.eye(len(self.labels), dtype=bool)
        return others if self.asked is None else others & self.asked

    @property
    def once(self) -> NDArray[np.bool_]:
        """Mask of the pairs, each once, shape (n, n)."""
        return np.triu(self.both_ways) if self.asked is None else self.both_ways


@dataclass(frozen=True, eq=False)
class Reliability:
    """Reliability diagram: pairs in `BINS` equal bins of predicted probability.

    `share` of the pairs in each bin, of sum 1, the mean predicted probability `said`, and the share `found`
    of one class, 0 in an empty bin, have the shape (BINS,). `base_rate` is the share of all pairs that are of
    one class.
    """

    share: Floats
    said: Floats
    found: Floats
    base_rate: float

    @property
    def error(self) -> float:
        """Expected calibration error: mean of |said - found| over the pairs (Naeini et al. 2015)."""
        return self.error_above(0)

    def error_above(self, first: int) -> float:
        """Return the calibration error over the pairs in the bins from `first` on; 0 if these are empty."""
        shares = self.share[first:]
        gaps = np.abs(self.said - self.found)[first:]
        return float(shares @ gaps / shares.sum()) if shares.sum() > 0.0 else 0.0


def fit_logistic(
    features: Floats,
    same: NDArray[np.bool_],
    weights: Floats,
    offsets: Floats | float = 0.0,
    start: Calibration | None = None,
) -> Calibration:
    """Fit the logistic model of maximum likelihood by Newton's method (reweighted least squares).

    `features`, shape (m, p), are those of m pairs, and `same`, shape (m,), tells which are of one class. Only
    the ratios of the `weights` > 0, shape (m,), matter; `offsets`, shape (m,), are the part of the log odds
    that is not fitted. A model near the result, to `start` from, saves steps. Raise ParameterError if all
    pairs are of one class, or none is.
    """
    if same.all() or not same.any():
        raise ParameterError("a calibration needs pairs of one class and pairs of two")
    weights = weights / weights.sum()
    centre = weights @ features
    spread = np.sqrt(weights @ (features - centre) ** 2)
    spread[spread < 1e-12] = 1.0
    design = np.column_stack([np.ones(len(features)), (features - centre) / spread])
    penalty = 2.0 * PENALTY * np.eye(design.shape[1])
    penalty[0, 0] = 0.0

    def loss(values: Floats) -> float:
        logits = design @ values + offsets
        return float(weights @ (np.logaddexp(0.0, logits) - same * logits) + 0.5 * values @ penalty @ values)

    values = np.zeros(design.shape[1])
    if start is not None:
        slopes = np.array(start.slopes)
        values[0], values[1:] = start.intercept + slopes @ centre, slopes * spread
    for _ in range(STEPS):
        probabilities = expit(design @ values + offsets)
        gradient = design.T @ (weights * (probabilities - same)) + penalty @ values
        curvature = (design * (weights * probabilities * (1.0 - probabilities))[:, None]).T @ design + penalty
        step = np.linalg.solve(curvature + 1e-12 * np.eye(len(values)), gradient)
        size, before = 1.0, loss(values)
        while loss(values - size * step) > before and size > 1e-6:
            size /= 2.0
        values = values - size * step
        if float(np.abs(step).max()) < CONVERGED:
            break
    slopes = values[1:] / spread
    return Calibration(float(values[0] - slopes @ centre), tuple(float(slope) for slope in slopes))


def fit(
    collections: Sequence[LabelledPairs], *, without: str | None = None, start: Calibration | None = None
) -> Calibration:
    """Return the model fitted to all pairs of all collections, or to the pairs without one class.

    `start` is that of `fit_logistic`. Raise ParameterError if all pairs are of one class, or none is.
    """
    features, same, weights, offsets = [], [], [], []
    for collection in collections:
        codes = collection.codes
        kept = codes != (without.casefold() if without is not None else None)
        first, second = np.nonzero(collection.once & kept[:, None] & kept)
        if len(first):
            features.append(collection.features[first, second])
            offsets.append(collection.added[first, second])
            same.append(codes[first] == codes[second])
            weights.append(np.full(len(first), collection.weight / len(first)))
    if not features:
        raise ParameterError("a calibration needs pairs of one class and pairs of two")
    joined = [np.concatenate(some) for some in (features, weights, offsets)]
    return fit_logistic(joined[0], np.concatenate(same), joined[1], joined[2], start)


def leave_class_out(collections: Sequence[LabelledPairs]) -> list[Floats]:
    """Compute class probabilities of all pairs, an array of shape (n, n) for each collection.

    The model of row i is fitted without the class of shape i. Raise ParameterError if without
    some class all pairs are of one class, or none is.
    """
    probabilities = [np.zeros(collection.features.shape[:2]) for collection in collections]
    whole = fit(collections)
    for label in sorted({str(code) for collection in collections for code in collection.codes}):
        model = fit(collections, without=label, start=whole)
        for collection, found in zip(collections, probabilities, strict=True):
            rows = collection.codes == label
            found[rows] = model.class_probability(collection.features[rows], collection.added[rows])
    return probabilities


def reliability(collections: Sequence[LabelledPairs], probabilities: Sequence[Floats]) -> Reliability:
    """Return the reliability of class probabilities, arrays of shape (n, n), one for each collection.

    Every collection has the same weight; a collection without pairs is ignored.
    """
    share, said, found = np.zeros(BINS), np.zeros(BINS), np.zeros(BINS)
    base_rate = 0.0
    judged = sum(bool(collection.both_ways.any()) for collection in collections)
    for collection, given in zip(collections, probabilities, strict=True):
        codes, pairs = collection.codes, collection.both_ways
        if not pairs.any():
            continue
        same, values = (codes[:, None] == codes)[pairs], given[pairs]
        places = np.minimum((values * BINS).astype(np.int64), BINS - 1)
        weight = 1.0 / (len(values) * judged)
        share += weight * np.bincount(places, minlength=BINS)
        said += weight * np.bincount(places, weights=values, minlength=BINS)
        found += weight * np.bincount(places, weights=same, minlength=BINS)
        base_rate += weight * float(same.sum())
    held = np.maximum(share, 1e-300)
    return Reliability(share=share, said=said / held, found=found / held, base_rate=base_rate)
