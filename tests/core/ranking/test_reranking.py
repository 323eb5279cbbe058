"""Screening: the plain match with flat splines, read from records; and what is not a record's."""

from itertools import product

import numpy as np
import pytest

from core.errors import BadRecordError
from core.gallery import make_shape
from core.matching.kernels.match_record import ONE, decoded
from core.matching.kernels.reranking import flat_splines
from core.matching.match_records import match_record, score_match_records
from core.matching.numpy_reference import fit_map_reference
from core.matching.procrustes import search_rounds
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.reranking import rerank
from core.serialization import embedding_to_bytes, points_from_bytes
from tests.core.matching.clouds import cloud, embedded

FIRST, LAST = DEFAULT.matching.first_dimensions, DEFAULT.matching.search_dimensions


@pytest.fixture(scope="module")
def embeddings():
    """Of the gallery; then of clouds with points between the samples, without, and with few samples."""
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
def clouds(embeddings):
    return [points_from_bytes(embedding_to_bytes(embedding)) for embedding in embeddings]


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


def test_it_is_the_plain_match_with_flat_splines(records, clouds):
    """Where rounding decides between two neighbours the two may part."""
    descriptor_distance = []
    for first, second in product(range(len(records)), repeat=2):
        other = decoded(records[second])
        splines = np.stack([flat(searched) for searched in other.searched])
        other = other._replace(operators=np.rint(splines * ONE).astype(np.int16), warp=None, radius=None)
        expected = fit_map_reference(decoded(records[first]), other, search_rounds(DEFAULT))[0]
        (found,) = rerank(records[first], [clouds[second]], DEFAULT)
        descriptor_distance.append(abs(float(found) - expected))
    assert np.median(descriptor_distance) < 1e-5
    assert np.mean(np.array(descriptor_distance) < 1e-4) > 0.9


def test_it_is_mostly_near_the_full_match(records, clouds):
    descriptor_distance = []
    for record in records[:4]:
        rough, exact = (
            rerank(record, clouds[:4], DEFAULT),
            score_match_records(record, records[:4], DEFAULT).cc,
        )
        descriptor_distance += list(np.abs(rough - exact))
    assert np.mean(np.array(descriptor_distance) < 0.01) >= 0.75


def test_many_are_reranked_as_one_by_one(records, clouds):
    found = rerank(records[0], clouds, DEFAULT)
    assert found.dtype == np.float32
    assert found.tolist() == [float(rerank(records[0], [one], DEFAULT)[0]) for one in clouds]
    assert rerank(records[0], [], DEFAULT).shape == (0,)


def test_the_points_of_a_record_are_those_of_the_embedding(embeddings, clouds):
    for embedding, (coordinates, regions) in zip(embeddings, clouds, strict=True):
        assert np.array_equal(regions, embedding.regions)
        for one, spectrum in zip(coordinates, embedding.spectra, strict=True):
            assert np.array_equal(one, spectrum.coordinates)


def changed(record, old, new):
    assert record.count(old) == 1
    return record.replace(old, new)


def test_bytes_that_are_no_record_have_no_points(embeddings):
    record = embedding_to_bytes(embeddings[0])
    for broken in (
        b"",
        b"not a record",
        bytes(100),
        record[:1000],
        record[:-60_000] if len(record) > 60_000 else record[:20_000],
        changed(record, b'"regions":{"dtype":"I32"', b'"regions":{"dtype":"F32"'),
        changed(record, b'"regions":{', b'"regionz":{'),
        changed(
            record,
            b'"coordinates_0":{"dtype":"F32","shape":[500,10]',
            b'"coordinates_0":{"dtype":"F32","shape":[50,100]',
        ),
        changed(
            record,
            b'"coordinates_0":{"dtype":"F32","shape":[500,10]',
            b'"coordinates_0":{"dtype":"F32","shape":[-500,-10]',
        ),
        (5).to_bytes(8, "little") + record[8:],
        (2**63).to_bytes(8, "little") + record[8:],
    ):
        with pytest.raises(BadRecordError):
            points_from_bytes(broken)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_have_no_score(records, clouds, value):
    (first, second), regions = clouds[0]
    broken = second.copy()
    broken[3, 1] = value
    found = rerank(records[1], [((first, broken), regions), clouds[0]], DEFAULT)
    assert np.isnan(found).tolist() == [True, False]


@pytest.mark.parametrize("region", [-1, -7, 500, 5_000, 101])
def test_regions_of_no_sample_have_no_score(records, clouds, region):
    coordinates, regions = clouds[0]
    broken = regions.copy()
    broken[-1] = region
    found = rerank(records[1], [(coordinates, broken), clouds[0]], DEFAULT)
    assert np.isnan(found).tolist() == [True, False]


def test_other_numbers_of_coordinates_have_no_score(records, clouds):
    (first, second), regions = clouds[0]
    others = [((first,), regions), ((first[:, :9].copy(), second[:, :9].copy()), regions), clouds[0]]
    assert np.isnan(rerank(records[1], others, DEFAULT)).tolist() == [True, True, False]
