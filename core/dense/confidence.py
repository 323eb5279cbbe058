"""How far a partner in the spectral domain can be trusted.

Confidence is a probability: of vertices with confidence p, a share p lies within `NEAR_TRUTH` of the true
partner. It rises with the agreement of the functions of both vertices. It falls with the cost and the
distortion of the whole map, which are high where one shape lacks a part: between individuals costs are high
as well, and only a wrong map is distorted. `python -m tests.studies.confidence` fits the coefficients and
measures the reliability diagram.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import expit

from core.arrays import Floats

NEAR_TRUTH = 0.05
"""Geodesic distance from the true partner over the root of the area, within which a partner is right."""

INTERCEPT, PER_AGREEMENT, PER_COST, PER_DISTORTION = -8.8, 11.5, -0.030, -4.3
"""Coefficients of the logistic regression of right partners, on pairs of which one map fits best; poses,
individuals, parts and scanned bodies count alike."""

MOST_STRETCHED = 1.0
"""Largest logarithm of the stretch of a vertex that counts in the distortion of a map."""


def agreement(rows: Floats, partners: Floats) -> Floats:
    """Return 1 where rows, shape (p, k), coincide with others, 0 where they are orthogonal or worse.

    It is 1 less the squared distance over the sum of the squared lengths.
    """
    lengths = np.einsum("ij,ij->i", rows, rows) + np.einsum("ij,ij->i", partners, partners)
    squares = ((rows - partners) ** 2).sum(axis=1)
    return np.asarray(np.clip(1.0 - squares / lengths, 0.0, 1.0))


def distortion(stretches: Sequence[Floats], areas: Sequence[Floats]) -> float:
    """Return how much a map distorts lengths: 0 for an isometry, at most `MOST_STRETCHED`.

    It is the mean size of the logarithm of the stretch, > 0, over the areas of the vertices; of the map and
    of the way back, the greater.
    """
    return max(
        float(np.average(np.minimum(np.abs(np.log(stretch)), MOST_STRETCHED), weights=shares))
        for stretch, shares in zip(stretches, areas, strict=True)
    )


def spectral_confidence(rows: Floats, partners: Floats, cost: float, distorted: float, maps: int) -> Floats:
    """Return the probability, in [0, 1], that partners are right, of rows as in `agreement`.

    `cost` tells how badly the whole map fits, and `maps` how many maps fit about equally well, of which one
    is right (`core.dense.functional_maps`); `distorted` is the `distortion` of the map.
    """
    scores = INTERCEPT + PER_AGREEMENT * agreement(rows, partners) + PER_COST * cost
    scores += PER_DISTORTION * distorted
    return np.asarray(expit(scores) / maps)
