"""The fit of `combined` against logistic models that are known, and what judging it may not read."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from core.errors import ParameterError
from core.evaluation.calibration import BINS, LabelledPairs, fit, fit_logistic, leave_class_out, reliability
from core.ranking.class_probability import Calibration

TRUE = Calibration(intercept=-3.0, slopes=(-2.0, 0.5))


def made(seed, labels):
    """A collection of which only the first number tells anything: it is lower where labels agree."""
    rng = np.random.default_rng(seed)
    codes = np.array(labels)
    n = len(codes)
    numbers = rng.normal(size=(n, n, 2))
    numbers[..., 0] += np.where(codes[:, None] == codes, -1.0, 1.0)
    return LabelledPairs(tuple(labels), 0.5 * (numbers + numbers.transpose(1, 0, 2)))


@pytest.mark.parametrize("offsets", [np.zeros(400), 2.0 * np.sin(np.arange(400.0))], ids=["none", "offsets"])
def test_a_logistic_is_recovered_from_its_own_chances(offsets):
    """Every point stands in both classes, weighed by its chances; offsets are known, and the rest is
    fitted."""
    points = np.random.default_rng(0).normal(loc=[0.0, 5.0], size=(400, 2))
    chances = TRUE.class_probability(points, offsets)
    same, weights = np.repeat([True, False], len(points)), np.concatenate([chances, 1.0 - chances])
    found = fit_logistic(np.concatenate([points, points]), same, weights, np.tile(offsets, 2))
    assert found.intercept == pytest.approx(TRUE.intercept, abs=0.02)
    assert found.slopes == pytest.approx(TRUE.slopes, abs=0.005)


def test_a_logistic_is_recovered_from_draws():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(40_000, 2))
    found = fit_logistic(
        points, rng.random(len(points)) < TRUE.class_probability(points), np.ones(len(points))
    )
    assert found.intercept == pytest.approx(TRUE.intercept, abs=0.1)
    assert found.slopes == pytest.approx(TRUE.slopes, abs=0.1)


def test_the_same_as_an_outside_library():
    rng = np.random.default_rng(2)
    points, same = rng.normal(size=(500, 3)) * [1.0, 20.0, 0.1] + [0.0, 300.0, 0.0], rng.random(500) < 0.3
    same |= points[:, 0] < -0.5
    weights = rng.uniform(0.5, 2.0, size=500)
    found = fit_logistic(points, same, weights)
    spread = points.std(axis=0)
    model = LogisticRegression(C=1e6, tol=1e-10, max_iter=10_000).fit(
        points / spread, same, sample_weight=weights
    )
    assert found.slopes == pytest.approx(model.coef_[0] / spread, rel=2e-3)
    assert found.intercept == pytest.approx(model.intercept_[0], rel=2e-3)


def test_classes_that_part_perfectly_have_a_fit():
    points = np.array([[-1.0], [-0.9], [0.9], [1.0]])
    found = fit_logistic(points, points[:, 0] < 0.0, np.ones(4))
    probabilities = found.class_probability(points)
    assert (probabilities[:2] > 0.99).all()
    assert (probabilities[2:] < 0.01).all()
    assert np.isfinite(found.slopes).all()


def test_evidence_that_never_varies_counts_nothing():
    points = np.random.default_rng(3).normal(size=(300, 2))
    points[:, 1] = 0.7
    same = points[:, 0] + np.random.default_rng(4).normal(size=300) < 0.0
    assert fit_logistic(points, same, np.ones(300)).slopes[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("same", [True, False])
def test_pairs_of_one_kind_have_no_fit(same):
    with pytest.raises(ParameterError):
        fit_logistic(np.arange(4.0)[:, None], np.full(4, same), np.ones(4))
    labels = ["a"] * 4 if same else ["a", "b", "c", "d"]
    with pytest.raises(ParameterError):
        fit([made(0, labels)])
    with pytest.raises(ParameterError):
        fit([made(0, ["a"])])


def test_every_collection_has_the_same_weight_and_every_pair_counts_once():
    small, large = made(0, ["a", "a", "b", "b", "c"]), made(1, [c for c in "defg" for _ in range(6)])
    rows, same, weights = [], [], []
    for collection in (small, large):
        pairs = list(combinations(range(len(collection.labels)), 2))
        for i, j in pairs:
            rows.append(collection.features[i, j])
            same.append(collection.labels[i] == collection.labels[j])
            weights.append(1.0 / len(pairs))
    expected = fit_logistic(np.array(rows), np.array(same), np.array(weights))
    found = fit([small, large])
    assert found.slopes == pytest.approx(expected.slopes, rel=1e-6)
    assert found.intercept == pytest.approx(expected.intercept, rel=1e-6)


def test_no_class_is_both_fitted_and_judged():
    """Whatever the pairs of a class look like, in either collection, they are judged by the same model."""
    first, second = (
        made(2, [c for c in "abcd" for _ in range(4)]),
        made(3, [c for c in "Aefg" for _ in range(4)]),
    )
    model = fit([first, second], without="a")
    spoilt = []
    for collection in (first, second):
        numbers = collection.features.copy()
        own = collection.codes == "a"
        numbers[own] += 3.0
        numbers[:, own] += 3.0
        spoilt.append(LabelledPairs(collection.labels, numbers))
    assert fit(spoilt, without="A") == model
    for collection, probabilities in zip(spoilt, leave_class_out(spoilt), strict=True):
        own = collection.codes == "a"
        expected = model.class_probability(collection.features[own])
        np.testing.assert_allclose(probabilities[own], expected, rtol=1e-7)
        other = collection.codes != "a"
        assert (probabilities[other] != model.class_probability(collection.features[other])).any()


def test_reliability_by_hand():
    labels = ("a", "a", "b")
    probabilities = np.array([[0.5, 0.95, 0.02], [0.95, 0.5, 0.04], [0.02, 0.08, 0.5]])
    pairs = LabelledPairs(labels, np.zeros((3, 3, 1)))
    found = reliability([pairs], [probabilities])
    assert found.base_rate == pytest.approx(2.0 / 6.0)
    assert found.share[[0, 9]] == pytest.approx([4.0 / 6.0, 2.0 / 6.0])
    assert found.said[[0, 9]] == pytest.approx([0.04, 0.95])
    assert found.found[[0, 9]] == pytest.approx([0.0, 1.0])
    assert (found.share[1:9] == 0.0).all()
    assert found.error == pytest.approx((4.0 * 0.04 + 2.0 * 0.05) / 6.0)
    assert found.error_above(5) == pytest.approx(0.05)
    assert reliability([pairs], [0.0 * probabilities]).error_above(5) == 0.0


def test_collections_weigh_the_same_and_a_chance_of_one_is_in_the_last_bin():
    two = LabelledPairs(("a", "a"), np.zeros((2, 2, 1)))
    four = LabelledPairs(("a", "b", "c", "d"), np.zeros((4, 4, 1)))
    found = reliability([two, four], [np.ones((2, 2)), np.full((4, 4), 0.25)])
    assert found.base_rate == pytest.approx(0.5)
    assert found.share[[2, BINS - 1]] == pytest.approx([0.5, 0.5])
    assert found.error == pytest.approx(0.5 * 0.25)


def test_classes_alike_in_kind_are_judged_calibrated():
    collections = [made(seed, [c for c in "abcdefgh" for _ in range(10)]) for seed in (5, 6)]
    probabilities = leave_class_out(collections)
    found = reliability(collections, probabilities)
    assert found.error < 0.02
    assert found.base_rate == pytest.approx(9.0 / 79.0)


def test_a_collection_of_small_weight_hardly_counts():
    one, other = made(5, list("aabbcc")), made(6, list("aabbcc"))
    lightly = replace(other, weight=1e-6)
    assert fit([one, lightly]).slopes == pytest.approx(fit([one]).slopes, rel=1e-2)
    assert fit([one, other]).slopes != pytest.approx(fit([one]).slopes, rel=1e-2)


def test_the_start_does_not_matter():
    pairs = made(7, list("aaabbbccc"))
    found = fit([pairs], start=Calibration(intercept=3.0, slopes=(-9.0, 2.0)))
    assert found.slopes == pytest.approx(fit([pairs]).slopes, rel=1e-6)
    assert found.intercept == pytest.approx(fit([pairs]).intercept, rel=1e-6)
