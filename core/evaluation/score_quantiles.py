"""Quantiles of a score over the pairs of one class and over the pairs of two classes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)


@dataclass(frozen=True)
class ScoreQuantiles:
    """The distribution of a score over some pairs.

    Attributes
    ----------
    pairs : int
        Number of pairs.
    quantiles : tuple of float
        The score at each of `QUANTILES`; linear interpolation.
    at_least : float
        Share of the pairs whose score reaches the threshold.
    """

    pairs: int
    quantiles: tuple[float, ...]
    at_least: float


def score_quantiles(
    scores: NDArray[np.float64], labels: Sequence[str], threshold: float
) -> dict[str, ScoreQuantiles]:
    """The distributions over pairs of the "same" class and of "other" classes, without those of no pairs.

    Parameters
    ----------
    scores : float64, shape (n, n)
        Symmetric; the diagonal is left out.
    labels : sequence of str, length n
        The class of each shape.
    threshold : float
    """
    first, second = np.triu_indices(len(labels), 1)
    named = np.asarray(labels)
    same = named[first] == named[second]
    values = scores[first, second]
    return {
        name: ScoreQuantiles(
            pairs=int(chosen.sum()),
            quantiles=tuple(np.quantile(values[chosen], QUANTILES).tolist()),
            at_least=float((values[chosen] >= threshold).mean()),
        )
        for name, chosen in (("same", same), ("other", ~same))
        if chosen.any()
    }
