"""How far a partner in the spectral domain can be trusted.

Confidence is a probability: of vertices with confidence p, a share p lies within `NEAR_TRUTH` of the true
partner. It rises with the agreement of the functions of both vertices, and falls with the cost of the whole
map, which is high where one shape lacks a part. `python -m tests.studies.confidence` fits the coefficients
and measures the reliability diagram.
"""

import numpy as np
from scipy.special import expit

from core.arrays import Floats

NEAR_TRUTH = 0.05
"""Geodesic distance from the true partner over the root of the area, within which a partner is right."""

INTERCEPT, PER_AGREEMENT, PER_COST = -8.4, 10.6, -0.054
"""Coefficients of the logistic regression of right partners, on pairs of which one map fits best."""


def agreement(rows: Floats, partners: Floats) -> Floats:
    """Return 1 where rows, shape (p, k), coincide with others, 0 where they are orthogonal or worse.

    It is 1 less the squared distance over the sum of the squared lengths.
    """
    lengths = np.einsum("ij,ij->i", rows, rows) + np.einsum("ij,ij->i", partners, partners)
    squares = ((rows - partners) ** 2).sum(axis=1)
    return np.asarray(np.clip(1.0 - squares / lengths, 0.0, 1.0))


def spectral_confidence(rows: Floats, partners: Floats, cost: float, maps: int) -> Floats:
    """Return the probability, in [0, 1], that partners are right, of rows as in `agreement`.

    `cost` tells how badly the whole map fits, and `maps` how many maps fit about equally well, of which one
    is right (`core.dense.functional_maps`).
    """
    scores = INTERCEPT + PER_AGREEMENT * agreement(rows, partners) + PER_COST * cost
    return np.asarray(expit(scores) / maps)
