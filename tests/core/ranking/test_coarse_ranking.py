"""Bytes: what they hold, and the rough match against the plain one on the same numbers."""

from itertools import permutations

import numpy as np
import pytest

from core.gallery import make_shape
from core.matching.kernels.match_record import decoded
from core.matching.match_records import match_record, score_match_records, search_rounds
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.ranking.reranking import COARSE_SAMPLES, coarse_ranking, coarse_samples
from tests.core.matching.clouds import cloud, embedded
from tests.core.matching.reference import best_map_reference

K = DEFAULT.spectral.dimensions
B = len(DEFAULT.spectral.operators)


def dequantised(quantised, columns):
    """The points of coarse samples, float64, shape (count, columns)."""
    count = int(quantised[:4].view(np.int32)[0])
    scales = quantised[4 : 4 + 4 * columns].view(np.float32)
    whole = quantised[4 + 4 * columns :].view(np.int8).reshape(COARSE_SAMPLES, columns)
    assert not whole[count:].any()
    return whole[:count] * scales.astype(np.float64)


@pytest.mark.parametrize(("m", "d"), [(100, 500), (COARSE_SAMPLES, 40), (12, 12)])
@pytest.mark.parametrize("k", [1, 3, 10])
def test_coarse_samples_hold_the_first_samples_to_a_127th_of_each_column(k, m, d):
    rng = np.random.default_rng(m)
    embedding = embedded([cloud(rng, d, k) for _ in range(2)], m)
    quantised = coarse_samples(embedding)
    assert (quantised.dtype, quantised.shape) == (np.uint8, (4 + 36 * 2 * k,))
    points = np.concatenate([one.coordinates for one in embedding.spectra], axis=1)[: min(m, COARSE_SAMPLES)]
    found = dequantised(quantised, 2 * k)
    assert found.shape == points.shape
    assert (np.abs(found - points) <= np.abs(points).max(axis=0) / 127 * 0.501).all()


def test_a_column_of_nothing_is_nothing():
    points = cloud(np.random.default_rng(1), 40, 4)
    points[:, 2] = 0.0
    assert not dequantised(coarse_samples(embedded([points], 40)), 4)[:, 2].any()


@pytest.fixture(scope="module")
def embeddings():
    """Of the gallery, and of clouds with more and fewer samples than a coarse ranking reads."""
    pipeline = Pipeline(DEFAULT)
    made = [pipeline.embed(make_shape(*name)) for name in (("spider", 0), ("spider", 1), ("hand", 0))]
    fingerprint = made[0].fingerprint
    for seed, (m, d) in enumerate([(60, 90), (20, 20), (100, 300)]):
        rng = np.random.default_rng(seed)
        one = embedded([cloud(rng, d, K) for _ in range(B)], m)
        made.append(type(one)(**{**vars(one), "fingerprint": fingerprint}))
    return made


def test_a_coarse_ranking_is_one_search_a_domain_refined_once(embeddings):
    records = [match_record(embedding, DEFAULT) for embedding in embeddings]
    quantised = np.stack([coarse_samples(embedding) for embedding in embeddings])
    rounds = search_rounds(DEFAULT)._replace(
        sides=1, kept_maps=1, align_rounds=0, align_samples=COARSE_SAMPLES
    )
    for i, j in permutations(range(len(records)), 2):
        (found,) = coarse_ranking(records[i], quantised[j : j + 1], DEFAULT)
        points = dequantised(quantised[j], B * K).astype(np.float32)
        blocks = np.split(points, B, axis=1)
        other = decoded(records[j])._replace(
            points=points,
            searched=np.stack([block[:, : DEFAULT.matching.search_dimensions].T for block in blocks]),
            offsets=np.arange(len(points) + 1, dtype=np.int32),
        )
        expected, _ = best_map_reference(decoded(records[i]), other, rounds)
        assert found == pytest.approx(expected, abs=1e-4)


def test_shapes_that_match_well_rank_well(embeddings):
    records = [match_record(embedding, DEFAULT) for embedding in embeddings[:3]]
    quantised = np.stack([coarse_samples(embedding) for embedding in embeddings[:3]])
    rough, exact = (
        coarse_ranking(records[0], quantised, DEFAULT),
        score_match_records(records[0], records, DEFAULT).cc,
    )
    assert rough == pytest.approx(exact, abs=0.1)
    assert np.array_equal(np.argsort(rough), np.argsort(exact))


def test_a_shape_without_samples_is_last(embeddings):
    record = match_record(embeddings[0], DEFAULT)
    nothing = np.zeros((1, len(coarse_samples(embeddings[0]))), dtype=np.uint8)
    assert coarse_ranking(record, nothing, DEFAULT).tolist() == [-1.0]
    assert coarse_ranking(record, nothing[:0], DEFAULT).shape == (0,)


def test_coarse_samples_that_cannot_be_written_to_give_the_same(embeddings):
    record = match_record(embeddings[0], DEFAULT)
    quantised = np.stack([coarse_samples(embedding) for embedding in embeddings])
    expected = coarse_ranking(record, quantised, DEFAULT)
    quantised.flags.writeable = False
    assert np.array_equal(coarse_ranking(record, quantised, DEFAULT), expected)


def test_coarse_samples_of_the_paper_s_setting():
    embedding = Pipeline(PAPER).embed(make_shape("hand", 0))
    columns = PAPER.spectral.dimensions * len(PAPER.spectral.operators)
    assert len(dequantised(coarse_samples(embedding), columns)) == COARSE_SAMPLES
