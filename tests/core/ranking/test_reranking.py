"""Re-ranking: the plain match with flat splines, from quantised samples; and bytes that are no samples."""

from itertools import product

import numpy as np
import pytest

from core.gallery import make_shape
from core.matching.kernels.match_record import ONE, decoded
from core.matching.kernels.quantised_samples import samples_of
from core.matching.kernels.reranking import flat_splines
from core.matching.match_records import match_record, score_match_records
from core.matching.numpy_reference import fit_map_reference
from core.matching.procrustes import search_rounds
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.quantised_samples import quantised_samples
from core.ranking.reranking import rerank
from tests.core.matching.clouds import cloud, embedded

COLUMNS = DEFAULT.spectral.dimensions * len(DEFAULT.spectral.operators)
FIRST, LAST = DEFAULT.matching.first_dimensions, DEFAULT.matching.search_dimensions


@pytest.fixture(scope="module")
def embeddings():
    """Of the gallery; then of points with points between the samples, without, and with few samples."""
    pipeline = Pipeline(DEFAULT)
    names = [("spider", 0), ("spider", 1), ("person", 0), ("hand", 0)]
    made = [pipeline.embed(make_shape(*name)) for name in names]
    fingerprint = made[0].fingerprint
    for seed, (m, d) in enumerate([(100, 300), (60, 60), (45, 91), (12, 12)]):
        rng = np.random.default_rng(seed)
        one = embedded([cloud(rng, d, DEFAULT.spectral.dimensions) for _ in DEFAULT.spectral.operators], m)
        made.append(type(one)(**{**vars(one), "fingerprint": fingerprint}))
    return made


@pytest.fixture(scope="module")
def records(embeddings):
    return [match_record(embedding, DEFAULT) for embedding in embeddings]


@pytest.fixture(scope="module")
def samples(embeddings):
    return [quantised_samples(embedding) for embedding in embeddings]


def plainly_read(data):
    """The coordinates in the bytes of quantised samples."""
    (m,) = np.frombuffer(data, np.int32, 1)
    scales = np.frombuffer(data, np.float32, COLUMNS, 4)
    return np.frombuffer(data, np.int8, m * COLUMNS, 4 + 4 * COLUMNS).reshape(m, COLUMNS) * scales


def flat(searched):
    """Flat splines of points by columns, (j, s), over one: shape (j - 2, s, s)."""
    operators = np.empty((1, len(searched) - FIRST + 1, *(searched.shape[1],) * 2), dtype=np.int16)
    flat_splines(np.ascontiguousarray(searched[None], dtype=np.float32), FIRST, operators)
    return operators[0] / ONE


@pytest.mark.parametrize("samples", [4, 7, 12, 32])
def test_flat_splines_are_least_squares_affine_maps(samples):
    points = cloud(np.random.default_rng(samples), samples, LAST)
    for k, found in enumerate(flat(points.T), start=FIRST):
        affine = np.concatenate([np.ones((samples, 1)), points[:, :k]], axis=1)
        assert found == pytest.approx(affine @ np.linalg.pinv(affine), abs=1e-3)


def test_coordinates_that_say_nothing_new_add_nothing():
    points = cloud(np.random.default_rng(4), 32, LAST)
    points[:, 4] = 0.0
    points[:, 5] = 2.0 * points[:, 0] + 1.0
    three, four, five, six = flat(points.T)
    assert np.array_equal(four, five)
    assert np.array_equal(four, six)
    assert not np.array_equal(three, four)


def test_it_is_the_plain_match_with_flat_splines(records, samples):
    """Where rounding decides between two neighbours the two may part."""
    rounds = search_rounds(DEFAULT)._replace(slides=0)
    differences = []
    for first, second in product(range(len(records)), repeat=2):
        other = decoded(records[second])
        points = plainly_read(samples[second])
        first_ones = points[: other.searched.shape[2]].T.reshape(
            len(other.searched), -1, other.searched.shape[2]
        )
        searched = np.ascontiguousarray(first_ones[:, :LAST])
        splines = np.stack([flat(one) for one in searched])
        other = other._replace(
            points=points,
            searched=searched,
            operators=np.rint(splines * ONE).astype(np.int16),
            warp=None,
            radius=None,
        )
        expected = fit_map_reference(decoded(records[first]), other, rounds)[0]
        (found,) = rerank(records[first], [samples[second]], DEFAULT)
        differences.append(abs(float(found) - expected))
    assert np.median(differences) < 1e-5
    assert np.mean(np.array(differences) < 1e-4) > 0.9


def test_it_is_mostly_near_the_full_match(records, samples):
    parameters = DEFAULT.with_values(slide_rounds=0)
    differences = []
    for record in records[:4]:
        rough = rerank(record, samples[:4], DEFAULT)
        differences += list(np.abs(rough - score_match_records(record, records[:4], parameters).cc))
    assert np.mean(np.array(differences) < 0.01) >= 0.75


def test_many_are_reranked_as_one_by_one(records, samples):
    found = rerank(records[0], samples, DEFAULT)
    assert found.dtype == np.float32
    assert found.tolist() == [float(rerank(records[0], [one], DEFAULT)[0]) for one in samples]
    assert rerank(records[0], [], DEFAULT).shape == (0,)


def test_samples_are_quantised_in_each_column(embeddings, samples):
    for embedding, data in zip(embeddings, samples, strict=True):
        exact = np.concatenate([one.coordinates for one in embedding.spectra], axis=1)
        coordinates = plainly_read(data)
        assert len(coordinates) == embedding.regions.max() + 1
        assert np.all(
            np.abs(coordinates - exact[: len(coordinates)]) <= 0.501 * np.abs(exact).max(axis=0) / 127
        )
        assert len(data) % 4 == 0
        assert np.array_equal(samples_of(np.frombuffer(data, np.uint8), COLUMNS), coordinates)


def with_number(data, place, number):
    """Samples with another int32 or float32 at a place of their bytes."""
    return data[: 4 * place] + np.array([number]).tobytes() + data[4 * place + 4 :]


def test_bytes_that_are_no_samples_have_no_score(records, samples):
    sound = samples[0]
    broken = [
        b"",
        b"not",
        b"nothing.",
        bytes(100),
        bytes(len(sound)),
        sound[:-4],
        sound[:-1],
        sound + bytes(4),
        with_number(sound, 0, np.int32(0)),
        with_number(sound, 0, np.int32(-1)),
        with_number(sound, 0, np.int32(2**31 - 1)),
        *(with_number(sound, 5, np.float32(value)) for value in (np.nan, np.inf, -np.inf, 3e38, -4e36)),
    ]
    found = rerank(records[1], [sound, *broken, samples[2]], DEFAULT)
    assert np.isnan(found).tolist() == [False, *(True for _ in broken), False]
    assert found[0] == rerank(records[1], [sound], DEFAULT)[0]
