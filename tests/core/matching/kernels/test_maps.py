"""Maps searched for, refined and chosen, and pairs scored: each step against the plain one."""

import numpy as np
import pytest

from core.matching.kernels.pair_matching import EXACT, best_map, refine_map, score_pairs, search_maps
from core.matching.numpy_reference import (
    best_map_reference,
    refine_map_reference,
    score_pairs_reference,
    search_maps_reference,
)
from core.matching.procrustes import search_rounds
from tests.core.matching.clouds import parameters_for, random_record

K = 10


def rotation_of(seed, k, blocks):
    found = np.zeros((blocks * k, blocks * k), dtype=np.float32)
    for block, rows in enumerate(np.split(np.arange(blocks * k), blocks)):
        rng = np.random.default_rng(seed + block)
        found[np.ix_(rows, rows)] = np.linalg.qr(rng.normal(size=(k, k)))[0]
    return found


def searched(x, y, rounds):
    columns = x.points.shape[1]
    rotations = np.zeros((rounds.sides * len(x.radius), columns, columns), dtype=np.float32)
    scores = np.zeros(len(rotations), dtype=np.float32)
    search_maps(x, y, rounds, rotations, scores)
    return scores, rotations


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "n"), [(60, 60), (40, 100), (100, 24)])
@pytest.mark.parametrize("k", [2, 3, 5, 10])
@pytest.mark.parametrize("sides", [1, 2])
def test_maps_searched_for_are_the_plain_ones(k, m, n, blocks, sides):
    x, y = random_record(k, m, m + 20, k, blocks), random_record(30 + k, n, n, k, blocks)
    rounds = search_rounds(parameters_for(k))._replace(sides=sides)
    scores, rotations = searched(x, y, rounds)
    plain_scores, plain = search_maps_reference(x, y, rounds)
    assert scores == pytest.approx(plain_scores, abs=1e-5)
    assert rotations == pytest.approx(plain, abs=5e-3)
    for one in range(blocks):
        own = slice(one * k, one * k + k)
        assert not np.delete(rotations[:, own], np.r_[own], axis=2).any()


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "n"), [(64, 64), (30, 100), (100, 40), (12, 12)])
@pytest.mark.parametrize("k", [2, 6, 10])
def test_a_map_is_refined_as_the_plain_one_is(k, m, n, blocks, count):
    x, y = (random_record(seed, rows, rows, k, blocks).points for seed, rows in ((k, m), (60 + k, n)))
    rotation = rotation_of(k, k, blocks)
    score, plain, plain_there, plain_back = refine_map_reference(
        x.astype(np.float64), y.astype(np.float64), blocks, count, EXACT, rotation.astype(np.float64)
    )
    there, back = np.empty(m, dtype=np.int32), np.empty(n, dtype=np.int32)
    targets = np.ascontiguousarray(y.T)
    found = refine_map(x, y, targets, blocks, count, EXACT, rotation, there, back)
    assert np.array_equal(there, plain_there)
    assert np.array_equal(back, plain_back)
    assert found == pytest.approx(score, abs=1e-5)
    assert rotation == pytest.approx(plain, abs=2e-3)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("m", "n"), [(60, 60), (50, 80), (110, 90)])
def test_the_best_map_is_the_plain_one(m, n, seed):
    x, y = random_record(seed, m, m, K, 2), random_record(70 + seed, n, n + 30, K, 2)
    for changes in ({}, {"sides": 1, "kept_maps": 1, "align_rounds": 0}):
        rounds = search_rounds(parameters_for(K))._replace(**changes)
        found = np.zeros((2 * K, 2 * K), dtype=np.float32)
        score = best_map(x, y, rounds, found)
        expected, plain = best_map_reference(x, y, rounds)
        assert score == pytest.approx(expected, abs=1e-4)
        assert found == pytest.approx(plain, abs=5e-3)


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "n"), [(50, 50), (30, 90), (90, 30), (12, 12)])
@pytest.mark.parametrize("k", [2, 5, 10])
def test_scores_are_those_of_the_definitions(k, m, n, blocks):
    x, y = random_record(k, m, m, k, blocks), random_record(80 + k, n, n, k, blocks)
    rng = np.random.default_rng(m + n)
    there, back = rng.integers(n, size=m), rng.integers(m, size=n)
    partners, sources = y.points[there], x.points[back]
    rotation = rotation_of(90 + k, k, blocks)
    for effective in (0.05, 0.5):
        scores = np.empty(3)
        score_pairs(
            x,
            y,
            there.astype(np.int32),
            back.astype(np.int32),
            partners,
            sources,
            rotation,
            effective,
            scores,
        )
        expected = score_pairs_reference(x, y, there, back, partners, sources, rotation, effective)
        assert scores == pytest.approx(expected, abs=1e-6)


def test_pairs_all_with_one_point_have_no_correlation_and_one_effective_partner():
    x, y = random_record(1, 40, 40, 4, 1), random_record(2, 30, 30, 4, 1)
    there, back = np.zeros(40, dtype=np.int32), np.zeros(30, dtype=np.int32)
    partners, sources = y.points[there], x.points[back]
    scores = np.empty(3)
    score_pairs(x, y, there, back, partners, sources, np.eye(4, dtype=np.float32), 0.05, scores)
    expected = score_pairs_reference(x, y, there, back, partners, sources, np.eye(4), 0.05)
    assert scores == pytest.approx(expected, abs=1e-6)
    assert scores[2] == pytest.approx(1 / 30)
