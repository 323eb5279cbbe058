"""Bytes: what they hold, and the rough match against the plain one on the same numbers."""

from itertools import permutations

import numpy as np
import pytest

from core.gallery import make_shape
from core.matching.kernels.match_record import unpacked
from core.matching.kernels.one_to_many import COARSE_SAMPLES
from core.matching.match_records import match_rows, row_of
from core.matching.procrustes import rounds_of
from core.matching.reference import best_map_reference
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.ranking.coarse_ranking import coarse_ranking, coarse_samples
from tests.core.matching.clouds import cloud, embedded

K = DEFAULT.spectral.dimensions
B = len(DEFAULT.spectral.operators)


def opened(sketch, columns):
    """The points in a sketch, float64, shape (count, columns)."""
    count = int(sketch[:4].view(np.int32)[0])
    scales = sketch[4 : 4 + 4 * columns].view(np.float32)
    whole = sketch[4 + 4 * columns :].view(np.int8).reshape(COARSE_SAMPLES, columns)
    assert not whole[count:].any()
    return whole[:count] * scales.astype(np.float64)


@pytest.mark.parametrize(("m", "d"), [(100, 500), (COARSE_SAMPLES, 40), (12, 12)])
@pytest.mark.parametrize("k", [1, 3, 10])
def test_a_sketch_holds_the_first_samples_to_a_127th_of_each_column(k, m, d):
    rng = np.random.default_rng(m)
    embedding = embedded([cloud(rng, d, k) for _ in range(2)], m)
    sketch = coarse_samples(embedding)
    assert (sketch.dtype, sketch.shape) == (np.uint8, (4 + 36 * 2 * k,))
    points = np.concatenate([one.coordinates for one in embedding.spectra], axis=1)[: min(m, COARSE_SAMPLES)]
    found = opened(sketch, 2 * k)
    assert found.shape == points.shape
    assert (np.abs(found - points) <= np.abs(points).max(axis=0) / 127 * 0.501).all()


def test_a_column_of_nothing_is_nothing():
    points = cloud(np.random.default_rng(1), 40, 4)
    points[:, 2] = 0.0
    assert not opened(coarse_samples(embedded([points], 40)), 4)[:, 2].any()


@pytest.fixture(scope="module")
def embeddings():
    """Of the gallery, and of clouds with more and fewer samples than a sketch has."""
    pipeline = Pipeline(DEFAULT)
    made = [pipeline.embed(make_shape(*name)) for name in (("spider", 0), ("spider", 1), ("hand", 0))]
    fingerprint = made[0].fingerprint
    for seed, (m, d) in enumerate([(60, 90), (20, 20), (100, 300)]):
        rng = np.random.default_rng(seed)
        one = embedded([cloud(rng, d, K) for _ in range(B)], m)
        made.append(type(one)(**{**vars(one), "fingerprint": fingerprint}))
    return made


def test_sifting_is_one_search_a_domain_refined_once(embeddings):
    rows = [row_of(embedding, DEFAULT) for embedding in embeddings]
    coarse_samples = np.stack([coarse_samples(embedding) for embedding in embeddings])
    rounds = rounds_of(DEFAULT)._replace(sides=1, kept_maps=1, align_rounds=0, align_samples=COARSE_SAMPLES)
    for i, j in permutations(range(len(rows)), 2):
        (found,) = coarse_ranking(rows[i], coarse_samples[j : j + 1], DEFAULT)
        points = opened(coarse_samples[j], B * K).astype(np.float32)
        blocks = np.split(points, B, axis=1)
        other = unpacked(rows[j])._replace(
            points=points,
            searched=np.stack([block[:, : DEFAULT.matching.search_dimensions].T for block in blocks]),
            offsets=np.arange(len(points) + 1, dtype=np.int32),
        )
        expected, _ = best_map_reference(unpacked(rows[i]), other, rounds)
        assert found == pytest.approx(expected, abs=1e-4)


def test_what_matches_well_sifts_well(embeddings):
    rows = [row_of(embedding, DEFAULT) for embedding in embeddings[:3]]
    coarse_samples = np.stack([coarse_samples(embedding) for embedding in embeddings[:3]])
    rough, exact = coarse_ranking(rows[0], coarse_samples, DEFAULT), match_rows(rows[0], rows, DEFAULT).cc
    assert rough == pytest.approx(exact, abs=0.1)
    assert np.array_equal(np.argsort(rough), np.argsort(exact))


def test_a_sketch_of_no_samples_is_last(embeddings):
    row = row_of(embeddings[0], DEFAULT)
    nothing = np.zeros((1, len(coarse_samples(embeddings[0]))), dtype=np.uint8)
    assert coarse_ranking(row, nothing, DEFAULT).tolist() == [-1.0]
    assert coarse_ranking(row, nothing[:0], DEFAULT).shape == (0,)


def test_sketches_that_cannot_be_written_to_give_the_same(embeddings):
    row = row_of(embeddings[0], DEFAULT)
    coarse_samples = np.stack([coarse_samples(embedding) for embedding in embeddings])
    expected = coarse_ranking(row, coarse_samples, DEFAULT)
    coarse_samples.flags.writeable = False
    assert np.array_equal(coarse_ranking(row, coarse_samples, DEFAULT), expected)


def test_a_sketch_of_the_paper_s_setting():
    embedding = Pipeline(PAPER).embed(make_shape("hand", 0))
    columns = PAPER.spectral.dimensions * len(PAPER.spectral.operators)
    assert len(opened(coarse_samples(embedding), columns)) == COARSE_SAMPLES
