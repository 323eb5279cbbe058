"""Algorithm 3: each shape takes the class of its first neighbour, or stays unmatched (Fig. 10).

The threshold follows from the collection. Each shape is a query twice, with its class present and with its
class left out. The threshold on the first neighbour's score maximises the balanced accuracy: the mean of the
share of matched queries in the first case and of unmatched queries in the second. Each shape is judged by the
threshold that is fitted to the shapes of all other classes. `TABLE_2` holds the accuracies of the paper.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.arrays import Floats, Ints
from core.errors import ParameterError
from core.evaluation.retrieval_measures import pair_distances


@dataclass(frozen=True, eq=False)
class Classification:
    """Leave-one-out classification of a collection of n shapes, each array of shape (n,).

    `neighbour` is the first of each shape, with its `score` in the units of the given scores; `matched` tells
    whether it reaches the threshold fitted to the shapes of all other classes, and `right` whether it is of
    the shape's class. `threshold` is fitted to all shapes. `balanced_accuracy`, in [0, 1], is the mean of the
    share of shapes matched with their class present, and of shapes unmatched without it, by thresholds that
    are fitted without the class of the shape.
    """

    neighbour: Ints
    score: Floats
    matched: NDArray[np.bool_]
    right: NDArray[np.bool_]
    threshold: float
    balanced_accuracy: float


def best_threshold(present: ArrayLike, absent: ArrayLike) -> float:
    """Return the threshold t that maximises the share of present >= t plus the share of absent < t.

    `present` and `absent` are finite, of one value at least, and larger is closer. Candidates are midpoints
    between neighbouring values; the lowest of equally good ones is taken. If no midpoint is better than the
    least value, the threshold is the least value, which matches everything.
    """
    inside, outside = np.sort(np.asarray(present, float)), np.sort(np.asarray(absent, float))
    values = np.unique(np.concatenate([inside, outside]))
    tries = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])
    matched = 1.0 - np.searchsorted(inside, tries, side="left") / len(inside)
    unmatched = np.searchsorted(outside, tries, side="left") / len(outside)
    gain = matched + unmatched
    return float(tries[np.argmax(gain >= gain.max() - 1e-12)])


def classify(scores: ArrayLike, labels: Sequence[str], *, larger_is_closer: bool) -> Classification:
    """Classify every shape by the others; parameters and errors are those of `retrieval_measures.evaluate`.

    ParameterError is also raised if there are fewer than three classes: a threshold is fitted to the other
    classes, each of which needs one more class when it is left out.
    """
    closeness = -pair_distances(scores, labels, larger_is_closer=larger_is_closer)
    classes, codes, sizes = np.unique(np.asarray(labels, dtype=str), return_inverse=True, return_counts=True)
    if len(classes) < 3:
        raise ParameterError("three classes or more are needed to set a threshold")
    np.fill_diagonal(closeness, -np.inf)
    neighbour = closeness.argmax(axis=1)
    present = closeness.max(axis=1)
    absent = np.where(codes[:, None] == codes, -np.inf, closeness).max(axis=1)
    known = sizes[codes] > 1
    matched = np.empty(len(codes), dtype=bool)
    refused = np.empty(len(codes), dtype=bool)
    for code in range(len(classes)):
        own, fitted = codes == code, (codes != code) & known
        threshold = best_threshold(present[fitted], absent[codes != code]) if fitted.any() else -np.inf
        matched[own] = present[own] >= threshold
        refused[own] = absent[own] < threshold
    threshold = best_threshold(present[known], absent) if known.any() else float(present.min())
    sign = 1.0 if larger_is_closer else -1.0
    return Classification(
        neighbour=neighbour,
        score=sign * present,
        matched=matched,
        right=codes[neighbour] == codes,
        threshold=sign * threshold,
        balanced_accuracy=0.5 * float(matched[known].mean() if known.any() else 0.0)
        + 0.5 * float(refused.mean()),
    )


METHODS = ("ours", "MDS", "ICP", "Parts", "TPS-RPM")
"""The columns of Table 2."""

ALL_CATEGORIES = 88.5
"""Average recognition accuracy of all models, in 16 categories, in per cent."""


class Category(NamedTuple):
    """A row of Table 2.

    `label` is the class of the Princeton Segmentation Benchmark, in lower case, and `accuracy` the average
    classification accuracy by method, in per cent.
    """

    title: str
    label: str
    accuracy: Mapping[str, float]


TABLE_2 = tuple(
    Category(title, label, dict(zip(METHODS, accuracy, strict=True)))
    for title, label, accuracy in (
        ("Humans", "human", (86.75, 83.69, 84.69, 86.45, 86.51)),
        ("Four-legged animals", "fourleg", (89.94, 83.75, 89.74, 84.32, 89.86)),
        ("Airplanes", "airplane", (88.67, 83.27, 86.52, 88.41, 88.36)),
        ("Birds", "bird", (81.58, 80.28, 81.69, 82.63, 80.92)),
        ("Fishes", "fish", (72.32, 71.57, 70.86, 70.96, 72.24)),
        ("Cups", "cup", (66.87, 67.38, 65.41, 60.24, 66.97)),
    )
)
