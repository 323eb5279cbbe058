"""The whole compiled match against the plain one, on the gallery and on clouds made by hand."""

from itertools import permutations

import numpy as np
import pytest
from numba import njit

from core.matching.kernels.nearest_neighbours import padded_rows
from core.matching.kernels.pair_matching import Pair, fit_maps, pair_of, refine_maps, score_pairs
from core.matching.kernels.procrustes import EXACT
from core.matching.match_records import search_rounds
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from tests.core.matching.clouds import (
    compared_pair,
    degenerate,
    embedded,
    parameters_for,
    random_record,
    record_of,
)
from tests.core.matching.reference import match_pair_reference, refine_map_reference, score_pairs_reference
from tests.gallery import make_shape

K = DEFAULT.spectral.dimensions
ROUNDS = search_rounds(DEFAULT)


@pytest.fixture(scope="module")
def shapes():
    """Shapes of the gallery; then clouds with points between the samples, without, and with few samples."""
    pipeline = Pipeline(DEFAULT)
    names = [("spider", 0), ("spider", 1), ("person", 0), ("hand", 0)]
    made = [record_of(pipeline.embed(make_shape(*name))) for name in names]
    return made + [
        random_record(i, m, d, K, 2) for i, (m, d) in enumerate([(100, 500), (60, 60), (45, 90), (32, 40)])
    ]


@njit
def fitted(x, y, rounds, rotations, scores):
    pairs = [pair_of(x, y)]
    fit_maps(pairs, rounds, rotations, scores)
    return pairs[0]


def match(x, y, rounds=ROUNDS):
    """Pairs both ways, map and scores, from the kernels of the steps."""
    columns = x.points.shape[1]
    rotations, scores = np.zeros((1, columns, columns), dtype=np.float32), np.full(3, np.nan)
    pair = Pair(*fitted(x, y, rounds, rotations, scores[:1]))
    score_pairs(pair, rotations[0], rounds.effective, scores)
    return pair.forward, pair.backward, rotations[0], scores


def alike(found, expected):
    """Whether both found the same pairs, whose maps, CC and SSD have to be the same, and the same sim."""
    if not all(np.array_equal(one, other) for one, other in zip(found[:2], expected[:2], strict=True)):
        return False
    assert found[2] == pytest.approx(expected[2], abs=1e-3)
    assert found[3][:2] == pytest.approx(expected[3][:2], abs=1e-4)
    return bool(abs(found[3][2] - expected[3][2]) <= 1e-4)


def test_the_match_is_the_plain_one(shapes):
    same = [alike(match(x, y), match_pair_reference(x, y, ROUNDS)) for x, y in permutations(shapes, 2)]
    assert np.mean(same) > 0.9


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize("k", [2, 3, 6, 12])
def test_any_number_of_domains_and_dimensions(k, blocks):
    rounds = search_rounds(parameters_for(k))
    clouds = [
        random_record(10 * k + i, m, d, k, blocks) for i, (m, d) in enumerate([(50, 80), (70, 70), (14, 30)])
    ]
    same = [
        alike(match(x, y, rounds), match_pair_reference(x, y, rounds)) for x, y in permutations(clouds, 2)
    ]
    assert np.mean(same) > 0.8


@pytest.mark.parametrize("changes", [{"slides": 0}, {"slides": 2, "final_rounds": 3}, {"kept_maps": 100}])
def test_any_number_of_rounds(changes):
    x, y = random_record(1, 70, 120, K, 2), random_record(3, 80, 100, K, 2)
    rounds = ROUNDS._replace(**changes)
    assert alike(match(x, y, rounds), match_pair_reference(x, y, rounds))


def test_many_are_compared_in_one_order_as_their_steps_say(shapes):
    for x, y in permutations(shapes[:2] + shapes[-2:], 2):
        scores, rotation = compared_pair(x, y)
        first, second = (
            (x, y)
            if (len(x.offsets), *x.key.view(np.uint32)) < (len(y.offsets), *y.key.view(np.uint32))
            else (y, x)
        )
        _, _, expected, expected_scores = match(first, second)
        assert np.array_equal(rotation, expected)
        assert np.array_equal(scores, expected_scores)


DEGENERATE = degenerate(60, K)


@pytest.mark.parametrize("points", DEGENERATE.values(), ids=DEGENERATE)
def test_a_cloud_without_volume_has_scores_in_range_and_a_map_that_does_not_stretch(points):
    odd = record_of(embedded([points] * 2, 60))
    other = random_record(2, 50, 80, K, 2)
    for x, y in ((odd, other), (other, odd), (odd, odd)):
        there, back, rotation, scores = match(x, y)
        assert 0 <= there.min() <= there.max() < len(y.offsets) - 1
        assert 0 <= back.min() <= back.max() < len(x.offsets) - 1
        assert np.linalg.norm(rotation, 2) < 1.001
        assert 0.0 <= scores[0] <= 1.0
        assert 0.0 <= scores[1] < 1.0
        assert 0.0 <= scores[2] <= 1.0


def test_as_few_samples_as_the_splines_need():
    x, y = random_record(4, K + 2, K + 2, K, 2), random_record(5, K + 2, 200, K, 2)
    for first, second in ((x, y), (y, x)):
        there, back, rotation, scores = match(first, second)
        expected = match_pair_reference(first, second, ROUNDS)
        assert there.max() < K + 2
        assert back.max() < K + 2
        assert np.linalg.norm(rotation, 2) < 1.001
        assert scores[0] == pytest.approx(expected[3][0], abs=0.1)


def test_the_same_match_twice_is_the_same_and_what_it_reads_is_left(shapes):
    before = [[array.copy() for array in shape] for shape in shapes]
    for x, y in permutations(shapes[:2] + shapes[-2:], 2):
        for one, other in zip(match(x, y), match(x, y), strict=True):
            assert np.array_equal(one, other)
    for shape, kept in zip(shapes, before, strict=True):
        assert all(np.array_equal(array, other) for array, other in zip(shape, kept, strict=True))


def rotation_of(seed, k, blocks):
    found = np.zeros((blocks * k, blocks * k), dtype=np.float32)
    for block, rows in enumerate(np.split(np.arange(blocks * k), blocks)):
        rng = np.random.default_rng(seed + block)
        found[np.ix_(rows, rows)] = np.linalg.qr(rng.normal(size=(k, k)))[0]
    return found


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("blocks", [1, 2])
@pytest.mark.parametrize(("m", "n"), [(30, 100), (100, 40), (12, 12)])
@pytest.mark.parametrize("k", [2, 10])
def test_a_map_is_refined_as_the_plain_one_is(k, m, n, blocks, count):
    x, y = (random_record(seed, rows, rows, k, blocks).points for seed, rows in ((k, m), (60 + k, n)))
    rotation = rotation_of(k, k, blocks)
    score, plain, plain_there, plain_back = refine_map_reference(
        x.astype(np.float64), y.astype(np.float64), blocks, count, EXACT, rotation.astype(np.float64)
    )
    there, back = np.empty(m, dtype=np.int32), np.empty(n, dtype=np.int32)
    found = np.empty(1)
    for _ in range(count):
        refine_maps(x, y, blocks, EXACT, rotation[None], found, there, back)
    assert np.array_equal(there, plain_there)
    assert np.array_equal(back, plain_back)
    assert found[0] == pytest.approx(score, abs=1e-5)
    assert rotation == pytest.approx(plain, abs=2e-3)


def paired(x, y, there, back):
    """A pair of shapes whose partners are samples."""
    pair, blocks = Pair(*pair_of(x, y)), len(x.radius)
    partners, sources = y.points[there], x.points[back]
    return pair._replace(
        forward=there.astype(np.int32),
        backward=back.astype(np.int32),
        partners=padded_rows(partners, len(partners), blocks),
        sources=padded_rows(sources, len(sources), blocks),
    )


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "n"), [(30, 90), (90, 30), (12, 12)])
@pytest.mark.parametrize("k", [2, 10])
def test_scores_are_those_of_the_definitions(k, m, n, blocks):
    x, y = random_record(k, m, m, k, blocks), random_record(80 + k, n, n, k, blocks)
    rng = np.random.default_rng(m + n)
    there, back = rng.integers(n, size=m), rng.integers(m, size=n)
    partners, sources = y.points[there], x.points[back]
    pair = paired(x, y, there, back)
    rotation = rotation_of(90 + k, k, blocks)
    for effective in (0.05, 0.5):
        scores = np.empty(3)
        score_pairs(pair, rotation, effective, scores)
        expected = score_pairs_reference(x, y, there, back, partners, sources, rotation, effective)
        assert scores == pytest.approx(expected, abs=1e-6)


def test_pairs_all_with_one_point_have_no_correlation_and_one_effective_partner():
    x, y = random_record(1, 40, 40, 4, 1), random_record(2, 30, 30, 4, 1)
    there, back = np.zeros(40, dtype=np.int32), np.zeros(30, dtype=np.int32)
    partners, sources = y.points[there], x.points[back]
    scores = np.empty(3)
    score_pairs(paired(x, y, there, back), np.eye(4, dtype=np.float32), 0.05, scores)
    expected = score_pairs_reference(x, y, there, back, partners, sources, np.eye(4), 0.05)
    assert scores == pytest.approx(expected, abs=1e-6)
    assert scores[2] == pytest.approx(1 / 30)
