"""Retrieval measures of the Princeton Shape Benchmark, from the scores of all pairs.

P. Shilane, P. Min, M. Kazhdan, T. Funkhouser, "The Princeton Shape Benchmark", Shape Modeling
International 2004, section 5.

Each shape in turn is the query; all other shapes are ranked from the closest to the farthest. Below, n is the
number of shapes, C the class of the query and |C| its size; R = |C| - 1 shapes are relevant, and rel(k) is 1
if the shape at rank k = 1, 2, ..., n - 1 is relevant, else 0.

Ties are broken against the ranking: at equal distance, shapes of other classes come first, in the order of
their class names, then of their rows. So a measure never depends on the order of the shapes, and constant
scores give no credit.

A class of one shape has no relevant shapes. Its shape is ranked for the other queries but is not a query, and
the class is left out of the means and of `per_class`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import skew

from core.arrays import Floats
from core.errors import ParameterError

E_MEASURE_RANKS = 32

OCCURRENCE_RANKS = 10
"""Number of first ranks in which the occurrences of each shape are counted."""


@dataclass(frozen=True)
class ClassFigures:
    """Nearest neighbour, first and second tier of one class, each the mean over its shapes."""

    nn: float
    ft: float
    st: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Retrieval measures of a collection; each figure is the mean over all queries, in [0, 1].

    Attributes
    ----------
    shapes, queries : int
        All shapes, and those whose class has at least two.
    nn : float
        Nearest neighbour: rel(1).
    ft, st : float
        First and second tier: the share of the relevant shapes within the first R, and 2R, ranks.
    e : float
        E-measure: 2 / (1/P + 1/Q), P and Q the precision and recall of the first 32 ranks (of all n - 1
        where there are fewer); 0 where neither finds anything.
    dcg : float
        Discounted cumulative gain, rel(1) + sum over k >= 2 of rel(k) / log2(k), over that of a perfect
        ranking, 1 + sum over k = 2 .. R of 1 / log2(k). (In print that sum goes to |C|; R makes a perfect
        ranking 1, as it must when the query is left out.)
    map : float
        Mean average precision: the mean, over the relevant shapes, of the precision at each one's rank.
    occurrence_skewness : float
        Skewness of the 10-occurrence, the number of shapes that have a shape among their first 10. Hubs make
        it large (Radovanovic, Nanopoulos, Ivanovic, "Hubs in Space", 2010). 0 where all shapes occur equally
        often.
    most_often_wrong : float
        The largest share of the queries that have one and the same shape of another class as their first
        neighbour.
    per_class : dict of str to ClassFigures
        By class name, in sorted order.
    classes : tuple of str
        All class names, sorted: the order of the rows and columns of `confusion`.
    confusion : int64, shape (c, c)
        How many queries of the row's class have a first neighbour of the column's class. Its trace over
        its sum is `nn`; the row of a class of one shape is zero.
    """

    shapes: int
    queries: int
    nn: float
    ft: float
    st: float
    e: float
    dcg: float
    map: float
    occurrence_skewness: float
    most_often_wrong: float
    per_class: dict[str, ClassFigures]
    classes: tuple[str, ...]
    confusion: NDArray[np.int64]


def evaluate(scores: ArrayLike, labels: Sequence[str], *, larger_is_closer: bool) -> Evaluation:
    """Compute every measure, from the scores of all pairs, shape (n, n), and the class of each shape.

    Row i ranks all shapes for query i; the diagonal is never read. `larger_is_closer` is true for
    similarities (CC, sim), and false for distances (SSD). Raise ParameterError if the arrays have wrong
    shapes, a score is not finite, or no class has two shapes.
    """
    distances = pair_distances(scores, labels, larger_is_closer=larger_is_closer)
    classes, codes, sizes = np.unique(np.asarray(labels, dtype=str), return_inverse=True, return_counts=True)
    queries = np.flatnonzero(sizes[codes] > 1)
    if len(queries) == 0:
        raise ParameterError("no class has two shapes, so there is nothing to find")

    order = _rankings(distances, codes)
    ranked = codes[order[queries]]
    own = codes[queries]
    relevant = ranked == own[:, None]
    wanted = sizes[own] - 1
    nn = relevant[:, 0].astype(np.float64)
    ft = _recall_within(relevant, wanted, wanted)
    st = _recall_within(relevant, 2 * wanted, wanted)
    confusion = np.zeros((len(classes), len(classes)), dtype=np.int64)
    np.add.at(confusion, (own, ranked[:, 0]), 1)
    occurrences = np.bincount(order[:, :OCCURRENCE_RANKS].ravel(), minlength=len(codes))
    wrong = np.bincount(order[queries, 0][nn == 0.0], minlength=len(codes))
    return Evaluation(
        shapes=len(codes),
        queries=len(queries),
        nn=float(nn.mean()),
        ft=float(ft.mean()),
        st=float(st.mean()),
        e=float(_e_measure(relevant, wanted).mean()),
        dcg=float(_discounted_gain(relevant, wanted).mean()),
        map=float(_average_precision(relevant, wanted).mean()),
        occurrence_skewness=float(skew(occurrences)) if np.ptp(occurrences) else 0.0,
        most_often_wrong=float(wrong.max() / len(queries)),
        per_class={
            str(classes[c]): ClassFigures(*(float(figure[own == c].mean()) for figure in (nn, ft, st)))
            for c in np.unique(own)
        },
        classes=tuple(str(name) for name in classes),
        confusion=confusion,
    )


def pair_distances(scores: ArrayLike, labels: Sequence[str], *, larger_is_closer: bool) -> Floats:
    """Return scores of all pairs as distances, similarities negated, shape (n, n), with a zero diagonal.

    Parameters and errors are those of `evaluate`.
    """
    distances = np.array(scores, dtype=np.float64)
    if distances.ndim != 2 or distances.shape[0] != distances.shape[1] or len(distances) == 0:
        raise ParameterError(f"scores must have shape (n, n), not {distances.shape}")
    if len(labels) != len(distances):
        raise ParameterError(f"{len(labels)} labels for {len(distances)} shapes")
    np.fill_diagonal(distances, 0.0)
    if not np.isfinite(distances).all():
        raise ParameterError("a score is not finite")
    return -distances if larger_is_closer else distances


def _rankings(distances: Floats, codes: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return in row i all shapes but i, the closest first, ties as the module says; shape (n, n - 1)."""
    keyed = distances.copy()
    np.fill_diagonal(keyed, -np.inf)
    same = codes[:, None] == codes[None, :]
    order = np.lexsort((np.broadcast_to(codes, keyed.shape), same, keyed), axis=-1)
    return order[:, 1:]


def _recall_within(relevant: NDArray[np.bool_], depth: NDArray[np.intp], wanted: NDArray[np.intp]) -> Floats:
    hits = relevant & (np.arange(1, relevant.shape[1] + 1) <= depth[:, None])
    return np.asarray(hits.sum(axis=1) / wanted)


def _e_measure(relevant: NDArray[np.bool_], wanted: NDArray[np.intp]) -> Floats:
    depth = min(E_MEASURE_RANKS, relevant.shape[1])
    # 2 / (1/P + 1/Q) with P = hits/depth and Q = hits/wanted, written so that no hit gives 0.
    return np.asarray(2.0 * relevant[:, :depth].sum(axis=1) / (depth + wanted))


def _discounted_gain(relevant: NDArray[np.bool_], wanted: NDArray[np.intp]) -> Floats:
    gains = 1.0 / np.log2(np.maximum(np.arange(1, relevant.shape[1] + 1), 2))
    return np.asarray((relevant * gains).sum(axis=1) / np.cumsum(gains)[wanted - 1])


def _average_precision(relevant: NDArray[np.bool_], wanted: NDArray[np.intp]) -> Floats:
    precision = np.cumsum(relevant, axis=1) / np.arange(1, relevant.shape[1] + 1)
    return np.asarray((precision * relevant).sum(axis=1) / wanted)


QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)


def score_quantiles(scores: Floats, labels: Sequence[str], threshold: float) -> dict[str, dict[str, Any]]:
    """Return the distributions over pairs of the "same" class and of "other" classes that have pairs.

    The scores, shape (n, n), are symmetric; the diagonal is left out. For each kind there are the number of
    `pairs`, the `quantiles` (the score at each of `QUANTILES`, by its text; linear interpolation), and
    `matched`, the share of the pairs whose score reaches the threshold.
    """
    first, second = np.triu_indices(len(labels), 1)
    named = np.asarray(labels)
    same, values = named[first] == named[second], scores[first, second]
    return {
        name: {
            "pairs": int(chosen.sum()),
            "quantiles": dict(
                zip(map(str, QUANTILES), np.quantile(values[chosen], QUANTILES).tolist(), strict=True)
            ),
            "matched": float((values[chosen] >= threshold).mean()),
        }
        for name, chosen in (("same", same), ("other", ~same))
        if chosen.any()
    }
