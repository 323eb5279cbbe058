"""The retrieval measures against hand-worked rankings, a slow plain reference, and what must not matter."""

from math import log2

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import ParameterError
from core.evaluation.retrieval_measures import QUANTILES, Evaluation, evaluate, score_quantiles

MEASURES = ("nn", "ft", "st", "e", "dcg", "map")

HAND_LABELS = ["A", "A", "A", "B", "B"]
# The others of each shape, closest first.
HAND_RANKINGS = [[1, 3, 2, 4], [0, 2, 3, 4], [3, 4, 0, 1], [4, 0, 1, 2], [0, 3, 1, 2]]


def distances_from(rankings: list[list[int]]) -> np.ndarray:
    distances = np.zeros((len(rankings), len(rankings)))
    for i, ranking in enumerate(rankings):
        distances[i, ranking] = np.arange(1, len(ranking) + 1)
    return distances


def plain_reference(distances: np.ndarray, labels: list[str]) -> dict[str, float]:
    """Each measure from its definition, one query and one rank at a time."""
    rows: dict[str, list[float]] = {name: [] for name in MEASURES}
    for i, label in enumerate(labels):
        others = [j for j in range(len(labels)) if j != i]
        others.sort(key=lambda j, i=i, label=label: (distances[i, j], labels[j] == label, labels[j], j))
        rel = [labels[j] == label for j in others]
        wanted = sum(rel)
        if wanted == 0:
            continue
        rows["nn"].append(float(rel[0]))
        rows["ft"].append(sum(rel[:wanted]) / wanted)
        rows["st"].append(sum(rel[: 2 * wanted]) / wanted)
        precision, recall = sum(rel[:32]) / len(rel[:32]), sum(rel[:32]) / wanted
        rows["e"].append(2 / (1 / precision + 1 / recall) if precision else 0.0)
        gain, ideal = float(rel[0]), 1.0
        for k in range(2, len(rel) + 1):
            gain += rel[k - 1] / log2(k)
            ideal += (k <= wanted) / log2(k)
        rows["dcg"].append(gain / ideal)
        rows["map"].append(sum(sum(rel[: k + 1]) / (k + 1) for k in range(len(rel)) if rel[k]) / wanted)
    return {name: sum(values) / len(values) for name, values in rows.items()}


def figures(evaluation: Evaluation) -> dict[str, float]:
    return {name: getattr(evaluation, name) for name in MEASURES}


def random_collection(seed: int, n: int, classes: int, levels: int = 0) -> tuple[np.ndarray, list[str]]:
    """Scores (with many ties where `levels` is given) and labels, two shapes at least in each class."""
    rng = np.random.default_rng(seed)
    codes = np.concatenate([np.repeat(np.arange(classes), 2), rng.integers(0, classes, n - 2 * classes)])
    scores = rng.integers(0, levels, (n, n)).astype(float) if levels else rng.random((n, n))
    return scores, [f"class {c}" for c in rng.permutation(codes)]


def test_hand_worked_ranking() -> None:
    found = evaluate(distances_from(HAND_RANKINGS), HAND_LABELS, larger_is_closer=False)
    third = 1 / log2(3)
    assert figures(found) == pytest.approx(
        {
            "nn": 3 / 5,
            "ft": (1 / 2 + 1 + 0 + 1 + 0) / 5,
            "st": 1.0,
            "e": (3 * 2 / 3 + 2 * 2 / 5) / 5,
            "dcg": ((1 + third) / 2 + 1 + (third + 1 / 2) / 2 + 1 + 1) / 5,
            "map": (5 / 6 + 1 + 5 / 12 + 1 + 1 / 2) / 5,
        }
    )
    assert found.per_class["A"].nn == pytest.approx(2 / 3)
    assert found.per_class["A"].ft == pytest.approx(1 / 2)
    assert found.per_class["B"].nn == pytest.approx(1 / 2)
    assert found.per_class["B"].st == pytest.approx(1.0)
    assert found.confusion.tolist() == [[2, 1], [1, 1]]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("levels", [0, 3])
def test_equals_the_plain_reference(seed: int, levels: int) -> None:
    distances, labels = random_collection(seed, n=90, classes=7, levels=levels)
    found = evaluate(distances, labels, larger_is_closer=False)
    assert figures(found) == pytest.approx(plain_reference(distances, labels), abs=1e-12)
    for name in found.classes:
        own = [label == name for label in labels]
        assert found.confusion[found.classes.index(name)].sum() == sum(own)
    assert np.trace(found.confusion) / found.confusion.sum() == pytest.approx(found.nn)


def test_a_hub_is_the_first_answer_of_many_queries_and_occurs_often() -> None:
    n, wrong = 40, 12
    labels = ["hub"] * 2 + ["a"] * (n - 2)
    distances = 1.0 + np.random.default_rng(0).random((n, n))
    even = evaluate(distances, labels, larger_is_closer=False)
    distances[2:, 0] = 0.5
    distances[n - wrong :, 0] = 3.0
    found = evaluate(distances, labels, larger_is_closer=False)
    assert found.most_often_wrong == (n - 2 - wrong) / n
    nearest = np.argsort(np.where(np.eye(n, dtype=bool), np.inf, distances), axis=1)[:, :10]
    counts = np.bincount(nearest.ravel(), minlength=n) - 10.0
    assert found.occurrence_skewness == pytest.approx((counts**3).mean() / (counts**2).mean() ** 1.5)
    assert found.occurrence_skewness > even.occurrence_skewness
    all_alike = evaluate(np.ones((4, 4)), ["a"] * 4, larger_is_closer=False)
    assert all_alike.most_often_wrong == all_alike.occurrence_skewness == 0.0


def test_perfect_ranking_is_one_and_its_reverse_finds_nothing_first() -> None:
    labels = ["a"] * 4 + ["b"] * 4 + ["c"] * 4
    distances = (np.asarray(labels)[:, None] != np.asarray(labels)[None, :]).astype(float)
    perfect = evaluate(distances, labels, larger_is_closer=False)
    assert [perfect.nn, perfect.ft, perfect.st, perfect.dcg, perfect.map] == pytest.approx([1.0] * 5)
    assert perfect.e == pytest.approx(2 * 3 / (11 + 3))
    assert perfect.confusion.tolist() == (4 * np.eye(3, dtype=int)).tolist()
    worst = evaluate(distances, labels, larger_is_closer=True)
    assert [worst.nn, worst.ft, worst.st] == [0.0, 0.0, 0.0]


def test_e_measure_reads_32_ranks() -> None:
    labels = ["a"] * 33 + ["b"] * 67
    distances = (np.asarray(labels)[:, None] != np.asarray(labels)[None, :]).astype(float)
    found = evaluate(distances, labels, larger_is_closer=False)
    # a: 32 wanted, all of the first 32. b: 66 wanted, 32 found: P = 1, Q = 32/66.
    assert found.e == pytest.approx((33 * 1.0 + 67 * 2 / (1 + 66 / 32)) / 100)


def test_chance_ranking_is_near_its_expectation() -> None:
    rng = np.random.default_rng(1)
    labels = [f"{c}" for c in np.repeat(np.arange(20), 20)]
    found = evaluate(rng.random((400, 400)), labels, larger_is_closer=True)
    share = 19 / 399
    assert found.nn == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 400))
    assert found.ft == pytest.approx(share, abs=0.01)
    assert found.st == pytest.approx(2 * share, abs=0.01)


def test_ties_earn_nothing() -> None:
    labels = ["a", "a", "b", "b", "b", "b"]
    found = evaluate(np.ones((6, 6)), labels, larger_is_closer=True)
    assert found.nn == 0.0
    assert found.per_class["a"].st == 0.0


@given(seed=st.integers(0, 10_000), levels=st.sampled_from([0, 4]))
def test_order_of_shapes_does_not_matter(seed: int, levels: int) -> None:
    scores, labels = random_collection(seed, n=24, classes=4, levels=levels)
    order = np.random.default_rng(seed + 1).permutation(24)
    before = evaluate(scores, labels, larger_is_closer=True)
    after = evaluate(scores[np.ix_(order, order)], [labels[i] for i in order], larger_is_closer=True)
    assert figures(after) == pytest.approx(figures(before), abs=1e-12)
    assert after.confusion.tolist() == before.confusion.tolist()


@given(seed=st.integers(0, 10_000))
def test_only_the_order_of_scores_matters(seed: int) -> None:
    scores, labels = random_collection(seed, n=20, classes=3)
    before = figures(evaluate(scores, labels, larger_is_closer=True))
    assert figures(evaluate(np.exp(3 * scores), labels, larger_is_closer=True)) == before
    assert figures(evaluate(-scores, labels, larger_is_closer=False)) == before


def test_diagonal_is_never_read() -> None:
    distances = distances_from(HAND_RANKINGS)
    before = figures(evaluate(distances, HAND_LABELS, larger_is_closer=False))
    for value in (-100.0, 100.0, np.nan):
        np.fill_diagonal(distances, value)
        assert figures(evaluate(distances, HAND_LABELS, larger_is_closer=False)) == before


def test_class_of_one_is_ranked_but_no_query() -> None:
    rankings = [[2, 1], [0, 2], [0, 1]]
    found = evaluate(distances_from(rankings), ["a", "a", "alone"], larger_is_closer=False)
    assert (found.shapes, found.queries) == (3, 2)
    assert found.nn == pytest.approx(1 / 2)
    assert list(found.per_class) == ["a"]
    assert found.classes == ("a", "alone")
    assert found.confusion.tolist() == [[1, 1], [0, 0]]


@pytest.mark.parametrize(
    ("scores", "labels", "part"),
    [
        (np.zeros((2, 3)), ["a", "a"], "shape"),
        (np.zeros((0, 0)), [], "shape"),
        (np.zeros((2, 2)), ["a"], "labels"),
        (np.array([[0, np.nan], [1, 0]]), ["a", "a"], "finite"),
        (np.zeros((2, 2)), ["a", "b"], "two shapes"),
    ],
)
def test_bad_input_is_named(scores: np.ndarray, labels: list[str], part: str) -> None:
    with pytest.raises(ParameterError, match=part):
        evaluate(scores, labels, larger_is_closer=False)


def test_pairs_of_one_class_and_of_two_are_told_apart():
    scores = np.array(
        [[9.0, 0.99, 0.5, 0.7], [0.99, 9.0, 0.6, 0.8], [0.5, 0.6, 9.0, 0.97], [0.7, 0.8, 0.97, 9.0]]
    )
    found = score_quantiles(scores, ["cup", "cup", "bird", "bird"], 0.98)
    assert (found["same"]["pairs"], found["other"]["pairs"]) == (2, 4)
    assert (found["same"]["matched"], found["other"]["matched"]) == (0.5, 0.0)
    assert found["same"]["quantiles"]["0.5"] == pytest.approx(0.98)
    assert found["other"]["quantiles"]["0.5"] == pytest.approx(0.65)
    expected = np.quantile([0.5, 0.6, 0.7, 0.8], QUANTILES)
    assert list(found["other"]["quantiles"].values()) == pytest.approx(expected)


def test_pairs_that_there_are_not_are_left_out():
    assert set(score_quantiles(np.eye(2), ["cup", "bird"], 0.98)) == {"other"}
    assert set(score_quantiles(np.eye(2), ["cup", "cup"], 0.98)) == {"same"}
