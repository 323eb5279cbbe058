"""Confidence: closed forms of the agreement, and what raises and lowers the probability."""

import numpy as np

from core.dense.confidence import MOST_STRETCHED, agreement, distortion, spectral_confidence

ROWS = np.eye(3)


def test_agreement_is_that_of_lengths_and_angles():
    np.testing.assert_allclose(agreement(ROWS, ROWS), 1.0)
    np.testing.assert_allclose(agreement(ROWS, ROWS[[1, 2, 0]]), 0.0)
    np.testing.assert_allclose(agreement(ROWS, -ROWS), 0.0)
    # At an angle of 60 degrees rows of one length are one length apart.
    np.testing.assert_allclose(agreement(ROWS[:1], np.array([[0.5, np.sqrt(0.75), 0.0]])), 0.5)


def test_confidence_is_a_probability_that_rises_with_agreement_and_falls_with_cost_and_distortion():
    angles = np.linspace(0.0, np.pi / 2, 9)
    partners = np.column_stack([np.cos(angles), np.sin(angles)])
    rows = np.tile([1.0, 0.0], (9, 1))
    low, high = (spectral_confidence(rows, partners, cost, 0.1, 1) for cost in (-60.0, 60.0))
    assert (np.diff(low) < 0.0).all()
    assert (np.diff(high) < 0.0).all()
    assert (high < low).all()
    assert high.min() >= 0.0
    assert low.max() <= 1.0
    assert (spectral_confidence(rows, partners, 60.0, 0.3, 1) < high).all()
    np.testing.assert_allclose(spectral_confidence(rows, partners, 60.0, 0.1, 4), high / 4)


def test_distortion_is_the_mean_logarithm_of_the_worse_way():
    areas = np.array([0.25, 0.75])
    isometry, doubled = np.ones(2), np.array([2.0, 1.0])
    assert distortion((isometry, isometry), (areas, areas)) == 0.0
    for ways in ((doubled, isometry), (isometry, 1.0 / doubled)):
        np.testing.assert_allclose(distortion(ways, (areas, areas)), 0.25 * np.log(2.0))
    assert distortion((np.full(2, 1e-9), isometry), (areas, areas)) == MOST_STRETCHED
