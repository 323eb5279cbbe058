"""Fitting the chance that two shapes are of one class to labelled collections, and judging it.

A logistic regression over all pairs (Platt 1999 calls it the calibration of a classifier's score). Every
collection has the same weight, whatever its size. Judged is what was not fitted: for each class, the pairs of
its shapes with all others, by a fit to the pairs without any shape of that class.
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
"""Of the slopes' squares, evidence standardised, beside the mean loss: a fit exists where classes part
perfectly, and nothing changes elsewhere."""

STEPS = 100
CONVERGED = 1e-9

BINS = 10


@dataclass(frozen=True, eq=False)
class Collection:
    """All pairs of n labelled shapes.

    Attributes
    ----------
    labels : tuple of str
        The class of each shape. Equal names in two collections, whatever their case, are one class.
    evidence : float64, shape (n, n, p)
        Symmetric in the first two, unless `asked` is given; the diagonal is never read.
    asked : bool, shape (n, n), optional
        The pairs that there are: i, not as it is but as a query, with j as it is. Without, all.
    """

    labels: tuple[str, ...]
    features: Floats
    asked: NDArray[np.bool_] | None = None

    @property
    def codes(self) -> NDArray[np.str_]:
        """The class names without regard to case, shape (n,)."""
        return np.array([label.casefold() for label in self.labels])

    @property
    def both_ways(self) -> NDArray[np.bool_]:
        """The pairs, each both ways where evidence is symmetric, shape (n, n)."""
        others = ~np.eye(len(self.labels), dtype=bool)
        return others if self.asked is None else others & self.asked

    @property
    def once(self) -> NDArray[np.bool_]:
        """The pairs, each once, shape (n, n)."""
        return np.triu(self.both_ways) if self.asked is None else self.both_ways


@dataclass(frozen=True, eq=False)
class Reliability:
    """Judged pairs by what was said of them: arrays of shape (`BINS`,), one a tenth of [0, 1].

    Attributes
    ----------
    share : float64
        Of the pairs; they sum to 1.
    said, found : float64
        The mean chance given, and the share that are of one class; 0 where there is no pair.
    base_rate : float
        The share of all pairs that are of one class.
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
        """The same over the pairs in the bins from `first` on; 0 if there are none."""
        shares = self.share[first:]
        gaps = np.abs(self.said - self.found)[first:]
        return float(shares @ gaps / shares.sum()) if shares.sum() > 0.0 else 0.0


def fit_logistic(features: Floats, same: NDArray[np.bool_], weights: Floats) -> Calibration:
    """The likeliest logistic model, by Newton's method (iteratively reweighted least squares).

    Parameters
    ----------
    evidence : float64, shape (m, p)
    same : bool, shape (m,)
    weights : float64, shape (m,)
        Positive; only their ratios matter.

    Raises
    ------
    ParameterError
        All pairs are of one kind.
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
        logits = design @ values
        return float(weights @ (np.logaddexp(0.0, logits) - same * logits) + 0.5 * values @ penalty @ values)

    values = np.zeros(design.shape[1])
    for _ in range(STEPS):
        probabilities = expit(design @ values)
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


def fit(collections: Sequence[Collection], *, without: str | None = None) -> Calibration:
    """The model of all pairs of all collections, or of those without one class.

    Raises
    ------
    ParameterError
        All pairs are of one kind.
    """
    features, same, weights = [], [], []
    for collection in collections:
        codes = collection.codes
        kept = codes != (without.casefold() if without is not None else None)
        first, second = np.nonzero(collection.once & kept[:, None] & kept)
        if len(first):
            features.append(collection.features[first, second])
            same.append(codes[first] == codes[second])
            weights.append(np.full(len(first), 1.0 / len(first)))
    if not features:
        raise ParameterError("a calibration needs pairs of one class and pairs of two")
    return fit_logistic(np.concatenate(features), np.concatenate(same), np.concatenate(weights))


def leave_class_out(collections: Sequence[Collection]) -> list[Floats]:
    """Chances of all pairs, shape (n, n) a collection: row i by the model fitted without the class of i.

    Raises
    ------
    ParameterError
        Without some class, all pairs are of one kind.
    """
    probabilities = [np.zeros(collection.features.shape[:2]) for collection in collections]
    for label in sorted({str(code) for collection in collections for code in collection.codes}):
        model = fit(collections, without=label)
        for collection, found in zip(collections, probabilities, strict=True):
            rows = collection.codes == label
            found[rows] = model.class_probability(collection.features[rows])
    return probabilities


def reliability(collections: Sequence[Collection], probabilities: Sequence[Floats]) -> Reliability:
    """How chances, shape (n, n) a collection, agree with the classes.

    Every collection weighs the same; one without pairs says nothing.
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
