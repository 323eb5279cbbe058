"""Re-ranking: the plain match with flat splines, from quantised points; and bytes that are no points."""

from itertools import product

import numpy as np
import pytest

from core.gallery import make_shape
from core.matching.kernels.match_record import ONE, decoded
from core.matching.kernels.one_to_many import flat_splines, points_of
from core.matching.match_records import match_record, score_match_records, search_rounds
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.reranking import quantised_points, rerank
from tests.core.matching.clouds import cloud, embedded
from tests.core.matching.reference import fit_map_reference

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
def points(embeddings):
    return [quantised_points(embedding) for embedding in embeddings]


def plainly_read(data):
    """The coordinates and the regions in the bytes of points."""
    d, columns = np.frombuffer(data, np.int32, 2)
    scales = np.frombuffer(data, np.float32, columns, 8)
    regions = np.frombuffer(data, np.int32, d, 8 + 4 * columns)
    whole = np.frombuffer(data, np.int8, d * columns, 8 + 4 * columns + 4 * d)
    return whole.reshape(d, columns) * scales, regions


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


def test_it_is_the_plain_match_with_flat_splines(records, points):
    """Where rounding decides between two neighbours the two may part."""
    descriptor_distance = []
    for first, second in product(range(len(records)), repeat=2):
        other = decoded(records[second])
        coordinates = plainly_read(points[second])[0]
        samples = coordinates[: other.searched.shape[2]].T.reshape(
            len(other.searched), -1, other.searched.shape[2]
        )
        searched = np.ascontiguousarray(samples[:, :LAST])
        splines = np.stack([flat(one) for one in searched])
        other = other._replace(
            points=coordinates,
            searched=searched,
            operators=np.rint(splines * ONE).astype(np.int16),
            warp=None,
            radius=None,
        )
        expected = fit_map_reference(decoded(records[first]), other, search_rounds(DEFAULT))[0]
        (found,) = rerank(records[first], [points[second]], DEFAULT)
        descriptor_distance.append(abs(float(found) - expected))
    assert np.median(descriptor_distance) < 1e-5
    assert np.mean(np.array(descriptor_distance) < 1e-4) > 0.9


def test_it_is_mostly_near_the_full_match(records, points):
    descriptor_distance = []
    for record in records[:4]:
        rough, exact = (
            rerank(record, points[:4], DEFAULT),
            score_match_records(record, records[:4], DEFAULT).cc,
        )
        descriptor_distance += list(np.abs(rough - exact))
    assert np.mean(np.array(descriptor_distance) < 0.01) >= 0.75


def test_many_are_reranked_as_one_by_one(records, points):
    found = rerank(records[0], points, DEFAULT)
    assert found.dtype == np.float32
    assert found.tolist() == [float(rerank(records[0], [one], DEFAULT)[0]) for one in points]
    assert rerank(records[0], [], DEFAULT).shape == (0,)


def test_points_are_quantised_in_each_column(embeddings, points):
    for embedding, data in zip(embeddings, points, strict=True):
        coordinates, regions = plainly_read(data)
        exact = np.concatenate([one.coordinates for one in embedding.spectra], axis=1)
        assert np.array_equal(regions, embedding.regions)
        assert np.all(np.abs(coordinates - exact) <= 0.501 * np.abs(exact).max(axis=0) / 127)
        assert len(data) % 4 == 0
        found = points_of(np.frombuffer(data, np.uint8), exact.shape[1])
        assert np.array_equal(found[0], coordinates)
        assert np.array_equal(found[1], regions)


def with_number(data, place, number):
    """Points with another int32 or float32 at a place of their bytes."""
    return data[: 4 * place] + np.array([number]).tobytes() + data[4 * place + 4 :]


COLUMNS = DEFAULT.spectral.dimensions * len(DEFAULT.spectral.operators)


def test_bytes_that_are_no_points_have_no_score(records, points):
    sound = points[0]
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
        with_number(sound, 1, np.int32(COLUMNS - 1)),
        with_number(sound, 1, np.int32(-1)),
        *(with_number(sound, 5, np.float32(value)) for value in (np.nan, np.inf, -np.inf, 3e38, -4e36)),
        *(with_number(sound, 2 + COLUMNS + 7, np.int32(region)) for region in (-1, 500, 2**31 - 1)),
    ]
    found = rerank(records[1], [sound, *broken, points[2]], DEFAULT)
    assert np.isnan(found).tolist() == [False, *(True for _ in broken), False]
    assert found[0] == rerank(records[1], [sound], DEFAULT)[0]
