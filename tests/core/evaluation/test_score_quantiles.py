"""Quantiles of a score by pairs of one class and of two."""

import numpy as np
import pytest

from core.evaluation.retrieval_measures import QUANTILES, score_quantiles


def test_pairs_of_one_class_and_of_two_are_told_apart():
    scores = np.array(
        [[9.0, 0.99, 0.5, 0.7], [0.99, 9.0, 0.6, 0.8], [0.5, 0.6, 9.0, 0.97], [0.7, 0.8, 0.97, 9.0]]
    )
    found = score_quantiles(scores, ["cup", "cup", "bird", "bird"], 0.98)
    assert (found["same"].pairs, found["other"].pairs) == (2, 4)
    assert found["same"].at_least == 0.5
    assert found["other"].at_least == 0.0
    median = QUANTILES.index(0.5)
    assert found["same"].quantiles[median] == pytest.approx(0.98)
    assert found["other"].quantiles[median] == pytest.approx(0.65)
    assert found["other"].quantiles == pytest.approx(np.quantile([0.5, 0.6, 0.7, 0.8], QUANTILES))


def test_pairs_that_there_are_not_are_left_out():
    assert set(score_quantiles(np.eye(2), ["cup", "bird"], 0.98)) == {"other"}
    assert set(score_quantiles(np.eye(2), ["cup", "cup"], 0.98)) == {"same"}
