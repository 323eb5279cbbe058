"""Algorithm 3 against a plain reference, and against collections whose answer is known."""

import numpy as np
import pytest

from core.errors import ParameterError
from core.evaluation.classification import best_threshold, classify

LABELS = ["a", "b", "c", "c", "a", "b", "b", "c", "d", "a", "e", "e"]


def random_scores(seed):
    rng = np.random.default_rng(seed)
    scores = rng.uniform(0, 1, size=(len(LABELS), len(LABELS)))
    scores = 0.5 * (scores + scores.T)
    same = np.array(LABELS)[:, None] == np.array(LABELS)
    return scores + 0.3 * same


def test_the_threshold_is_the_best_of_all():
    for seed in range(50):
        rng = np.random.default_rng(seed)
        present, absent = rng.normal(1, 1, size=9).round(1), rng.normal(0, 1, size=7).round(1)

        def gain(t, present=present, absent=absent):
            return (present >= t).mean() + (absent < t).mean()

        found = best_threshold(present, absent)
        everywhere = np.arange(-6, 6, 0.025)
        assert gain(found) == pytest.approx(max(gain(t) for t in everywhere))


def test_the_threshold_lies_in_the_middle_of_a_gap():
    assert best_threshold([0.9, 0.8], [0.1, 0.4]) == pytest.approx(0.6)
    assert best_threshold([0.1, 0.2], [0.8, 0.9]) == 0.1


@pytest.mark.parametrize("seed", range(5))
def test_the_same_as_shape_by_shape(seed):
    scores = random_scores(seed)
    found = classify(scores, LABELS, larger_is_closer=True)
    n = len(LABELS)
    best = [max((j for j in range(n) if j != i), key=lambda j, i=i: scores[i, j]) for i in range(n)]
    present = [scores[i, best[i]] for i in range(n)]
    absent = [max(scores[i, j] for j in range(n) if LABELS[j] != LABELS[i]) for i in range(n)]
    kept, refused = [], []
    for i in range(n):
        others = [j for j in range(n) if LABELS[j] != LABELS[i]]
        known = [j for j in others if LABELS.count(LABELS[j]) > 1]
        threshold = best_threshold([present[j] for j in known], [absent[j] for j in others])
        assert found.matched[i] == (present[i] >= threshold)
        if LABELS.count(LABELS[i]) > 1:
            kept.append(present[i] >= threshold)
        refused.append(absent[i] < threshold)
    np.testing.assert_array_equal(found.neighbour, best)
    np.testing.assert_array_equal(found.score, present)
    np.testing.assert_array_equal(found.right, [LABELS[i] == LABELS[j] for i, j in enumerate(best)])
    assert found.balanced_accuracy == pytest.approx(0.5 * np.mean(kept) + 0.5 * np.mean(refused))


def test_a_shape_that_is_like_nothing_stays_unmatched():
    labels = ["a"] * 3 + ["b"] * 3 + ["c"] * 3 + ["stray"]
    same = np.array(labels)[:, None] == np.array(labels)
    found = classify(np.where(same, 0.99, 0.5), labels, larger_is_closer=True)
    np.testing.assert_array_equal(found.matched, [True] * 9 + [False])
    np.testing.assert_array_equal(found.right, [True] * 9 + [False])
    assert found.threshold == pytest.approx(0.745)
    assert found.balanced_accuracy == 1.0


def test_a_class_is_judged_without_its_own_scores():
    labels = ["a"] * 3 + ["b"] * 3 + ["c"] * 3
    same = np.array(labels)[:, None] == np.array(labels)
    scores = np.where(same, 0.9, 0.3)
    # Far apart among themselves: by their own scores they would be matched, by the others' they are not.
    scores[:3, :3] = 0.4
    found = classify(scores, labels, larger_is_closer=True)
    np.testing.assert_array_equal(found.matched, [False] * 3 + [True] * 6)


def test_distances_are_similarities_turned_round():
    scores = random_scores(3)
    near, far = (classify(sign * scores, LABELS, larger_is_closer=sign > 0) for sign in (1.0, -1.0))
    np.testing.assert_array_equal(near.matched, far.matched)
    np.testing.assert_array_equal(near.score, -far.score)
    assert near.threshold == -far.threshold


def test_the_order_of_the_shapes_changes_nothing():
    scores, order = random_scores(4), np.random.default_rng(0).permutation(len(LABELS))
    first = classify(scores, LABELS, larger_is_closer=True)
    second = classify(scores[np.ix_(order, order)], [LABELS[i] for i in order], larger_is_closer=True)
    np.testing.assert_array_equal(first.matched[order], second.matched)
    np.testing.assert_array_equal(first.neighbour[order], order[second.neighbour])
    assert first.threshold == second.threshold


@pytest.mark.parametrize(
    ("scores", "labels"),
    [
        (np.zeros((3, 2)), ["a", "b", "c"]),
        (np.zeros((2, 2)), ["a", "b"]),
        (np.full((3, 3), np.nan), ["a", "b", "c"]),
    ],
)
def test_scores_that_cannot_be_used(scores, labels):
    with pytest.raises(ParameterError):
        classify(scores, labels, larger_is_closer=True)
