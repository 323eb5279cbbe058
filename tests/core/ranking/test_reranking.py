"""Approximate CC from coarse samples, against the plain match on the same numbers."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from core.matching.kernels.match_record import decoded
from core.matching.kernels.one_to_many import flat_splines
from core.matching.match_records import match_record, score_match_records, search_rounds
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.ranking.reranking import KEPT_SAMPLES, coarse_samples, rerank
from tests.core.matching.clouds import cloud, embedded, random_embedding
from tests.core.matching.reference import best_map_reference, padded
from tests.gallery import make_shape

FIRST, LAST = DEFAULT.matching.first_dimensions, DEFAULT.matching.search_dimensions


@pytest.fixture(scope="module")
def embeddings():
    """Of the gallery; then of points with points between the samples, without, and with few samples."""
    pipeline = Pipeline(DEFAULT)
    names = [("spider", 0), ("spider", 1), ("person", 0), ("hand", 0)]
    made = [pipeline.embed(make_shape(*name)) for name in names]
    fingerprint = made[0].fingerprint
    for seed, (m, d) in enumerate([(100, 300), (60, 60), (45, 91), (12, 12)]):
        made.append(replace(random_embedding(seed, m, d), fingerprint=fingerprint))
    return made


@pytest.fixture(scope="module")
def records(embeddings):
    return [match_record(embedding, DEFAULT) for embedding in embeddings]


@pytest.fixture(scope="module")
def samples(embeddings):
    return np.stack([coarse_samples(embedding) for embedding in embeddings])


def flat(searched):
    """Flat splines of points by columns, (j, s): shape (j - 2, s, s)."""
    operators = np.empty((1, len(searched) - FIRST + 1, *(searched.shape[1],) * 2), dtype=np.float32)
    flat_splines(np.ascontiguousarray(searched[None], dtype=np.float32), FIRST, operators)
    return operators[0]


@pytest.mark.parametrize("samples", [4, 7, 12, 32])
def test_flat_splines_are_least_squares_affine_maps(samples):
    points = cloud(samples, samples, LAST)
    for k, found in enumerate(flat(points.T), start=FIRST):
        affine = np.concatenate([np.ones((samples, 1)), points[:, :k]], axis=1)
        assert found == pytest.approx(affine @ np.linalg.pinv(affine), abs=1e-3)


def test_coordinates_that_say_nothing_new_add_nothing():
    points = cloud(4, 32, LAST)
    points[:, 4] = 0.0
    points[:, 5] = 2.0 * points[:, 0] + 1.0
    three, four, five, six = flat(points.T)
    assert np.array_equal(four, five)
    assert np.array_equal(four, six)
    assert not np.array_equal(three, four)


B = len(DEFAULT.spectral.operators)
COLUMNS = DEFAULT.spectral.dimensions * B


def other_record(record, quantised):
    """A match record with some coarse samples in place of its points."""
    points = dequantised(quantised, COLUMNS).astype(np.float32)
    some = points[: DEFAULT.matching.search_samples]
    return record._replace(
        points=points,
        searched=np.stack([block[:, :LAST].T for block in np.split(some, B, axis=1)]),
        offsets=np.arange(len(points) + 1, dtype=np.int32),
    )


def test_a_reranking_is_the_best_map_with_flat_splines(records, samples):
    """Where rounding decides between two neighbours the two may part."""
    rounds = search_rounds(DEFAULT)._replace(kept_maps=1, align_samples=KEPT_SAMPLES)
    differences = []
    for first, second in product(range(len(records)), repeat=2):
        other = other_record(decoded(records[second]), samples[second])
        splines = np.stack([flat(one) for one in other.searched])
        other = other._replace(operators=padded(splines))
        expected, _ = best_map_reference(decoded(records[first]), other, rounds)
        (found,) = rerank(records[first], samples[second : second + 1], DEFAULT)
        differences.append(abs(float(found) - expected))
    assert np.median(differences) < 1e-5
    assert np.mean(np.array(differences) < 1e-4) > 0.9


def test_many_are_reranked_as_one_by_one(records, samples):
    found = rerank(records[0], samples, DEFAULT)
    assert found.dtype == np.float32
    assert found.tolist() == [float(rerank(records[0], one[None], DEFAULT)[0]) for one in samples]
    assert rerank(records[0], samples[:0], DEFAULT).shape == (0,)


def dequantised(quantised, columns):
    """The points of coarse samples, float64, shape (count, columns)."""
    count = int(quantised[:4].view(np.int32)[0])
    scales = quantised[4 : 4 + 4 * columns].view(np.float32)
    whole = quantised[4 + 4 * columns :].view(np.int8).reshape(KEPT_SAMPLES, columns)
    assert not whole[count:].any()
    return whole[:count] * scales.astype(np.float64)


@pytest.mark.parametrize(("m", "d"), [(100, 500), (KEPT_SAMPLES, 60), (12, 12)])
@pytest.mark.parametrize("k", [1, 3, 10])
def test_coarse_samples_hold_the_first_samples_to_a_127th_of_each_column(k, m, d):
    embedding = random_embedding(m, m, d, k)
    quantised = coarse_samples(embedding)
    assert (quantised.dtype, quantised.shape) == (np.uint8, (4 + (4 + KEPT_SAMPLES) * 2 * k,))
    points = np.concatenate([one.coordinates for one in embedding.spectra], axis=1)[: min(m, KEPT_SAMPLES)]
    found = dequantised(quantised, 2 * k)
    assert found.shape == points.shape
    assert (np.abs(found - points) <= np.abs(points).max(axis=0) / 127 * 0.501).all()


def test_a_column_of_nothing_is_nothing():
    points = cloud(1, 40, 4)
    points[:, 2] = 0.0
    assert not dequantised(coarse_samples(embedded([points], 40)), 4)[:, 2].any()


def test_shapes_that_match_well_rank_well(embeddings):
    embeddings = [embeddings[i] for i in (0, 1, 3)]
    records = [match_record(embedding, DEFAULT) for embedding in embeddings]
    quantised = np.stack([coarse_samples(embedding) for embedding in embeddings])
    rough = rerank(records[0], quantised, DEFAULT)
    quantised.flags.writeable = False
    assert np.array_equal(rerank(records[0], quantised, DEFAULT), rough)
    exact = score_match_records(records[0], records, DEFAULT).cc
    assert rough == pytest.approx(exact, abs=0.1)
    assert rough.argmax() == exact.argmax() == 0


def test_a_shape_without_samples_is_last(records, samples):
    nothing = np.zeros((1, samples.shape[1]), dtype=np.uint8)
    damaged = nothing.copy()
    damaged[0, :4] = 255
    for none in (nothing, damaged):
        assert rerank(records[0], none, DEFAULT).tolist() == [-1.0]
    assert rerank(records[0], nothing[:0], DEFAULT).shape == (0,)


def test_coarse_samples_of_the_paper_s_setting():
    embedding = Pipeline(PAPER).embed(make_shape("hand", 0))
    columns = PAPER.spectral.dimensions * len(PAPER.spectral.operators)
    assert len(dequantised(coarse_samples(embedding), columns)) == KEPT_SAMPLES
