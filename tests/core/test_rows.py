"""Rows of flat splines, and screening by them: what they hold, and the plain match on them."""

from itertools import product

import numpy as np
import pytest

from core.errors import BadRecordError
from core.gallery import make_shape
from core.kernels.packed import ONE, unpacked
from core.kernels.reference import fit_map_reference
from core.mutual import rounds_of
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.records import embedding_to_bytes, points_from_bytes
from core.rows import match_rows, points_row_of, row_of, screen_rows
from tests.core.clouds import cloud, embedded

ROUNDS = rounds_of(DEFAULT)


@pytest.fixture(scope="module")
def records():
    """Of the gallery; then of clouds with points between the samples, without, and with few samples."""
    pipeline = Pipeline(DEFAULT)
    names = [("spider", 0), ("spider", 1), ("person", 0), ("hand", 0)]
    made = [pipeline.embed(make_shape(*name)) for name in names]
    fingerprint = made[0].fingerprint
    for seed, (m, d) in enumerate([(100, 300), (60, 60), (45, 91), (12, 12)]):
        rng = np.random.default_rng(seed)
        one = embedded([cloud(rng, d, DEFAULT.dimensions) for _ in DEFAULT.operators], m)
        made.append(type(one)(**{**vars(one), "fingerprint": fingerprint}))
    return made


@pytest.fixture(scope="module")
def rows(records):
    return [row_of(embedding, DEFAULT) for embedding in records]


@pytest.fixture(scope="module")
def points_rows(records):
    return [points_row_of(*_points(embedding), DEFAULT) for embedding in records]


def _points(embedding):
    points = np.concatenate([one.coordinates for one in embedding.spectra], axis=1)
    return points, embedding.regions


def test_it_is_the_row_but_for_the_splines(rows, points_rows):
    for row, light in zip(rows, points_rows, strict=True):
        whole, part = unpacked(row), unpacked(light)
        for name in ("points", "searched", "offsets", "members"):
            assert np.array_equal(getattr(part, name), getattr(whole, name)), name
        assert part.operators.shape == whole.operators.shape
        assert part.warp.size == 0


def test_flat_splines_are_least_squares_affine_maps(points_rows):
    for light in points_rows:
        shape = unpacked(light)
        for searched, operators in zip(shape.searched, shape.operators, strict=True):
            for stage, operator in enumerate(operators):
                k = DEFAULT.first_dimensions + stage
                affine = np.concatenate([np.ones_like(searched[:1]), searched[:k]]).T.astype(np.float64)
                expected = affine @ np.linalg.pinv(affine)
                assert operator / ONE == pytest.approx(expected, abs=1e-4)


def test_coordinates_that_say_nothing_new_add_nothing_to_a_flat_spline():
    points = cloud(np.random.default_rng(4), 40, DEFAULT.dimensions)
    points[:, 4] = 0.0
    points[:, 5] = 2.0 * points[:, 0] + 1.0
    embedding = embedded([points for _ in DEFAULT.operators], 40)
    operators = unpacked(points_row_of(*_points(embedding), DEFAULT)).operators[0]
    assert np.array_equal(operators[1], operators[2])
    assert np.array_equal(operators[1], operators[3])
    assert not np.array_equal(operators[0], operators[1])


def test_screening_is_the_plain_match_from_one_side(rows, points_rows):
    """Where rounding decides between two neighbours the two may part."""
    apart = []
    for row, light in product(rows, points_rows):
        expected = fit_map_reference(unpacked(row), unpacked(light), ROUNDS)[0]
        apart.append(abs(float(screen_rows(row, [light], DEFAULT)[0]) - expected))
    assert np.median(apart) < 1e-5
    assert np.mean(np.array(apart) < 1e-4) > 0.9


def test_screening_is_mostly_near_the_full_match(rows, points_rows):
    apart = []
    for row in rows[:4]:
        rough, exact = screen_rows(row, points_rows[:4], DEFAULT), match_rows(row, rows[:4], DEFAULT).cc
        apart += list(np.abs(rough - exact))
    assert np.mean(np.array(apart) < 0.01) >= 0.75


def test_the_points_of_a_record_are_those_of_the_embedding(records):
    for embedding in records:
        points, regions = points_from_bytes(embedding_to_bytes(embedding))
        assert np.array_equal(points, _points(embedding)[0])
        assert np.array_equal(regions, embedding.regions)


@pytest.mark.parametrize("data", [b"", b"not a record", bytes(100)])
def test_what_is_no_record_has_no_points(data):
    with pytest.raises(BadRecordError):
        points_from_bytes(data)


def test_points_that_are_not_finite_are_refused(records):
    embedding = records[0]
    first = embedding.spectra[0]
    broken = first.coordinates.copy()
    broken[3, 1] = np.nan
    spectra = (type(first)(first.name, first.eigenvalues, broken), *embedding.spectra[1:])
    data = embedding_to_bytes(type(embedding)(**{**vars(embedding), "spectra": spectra}))
    with pytest.raises(BadRecordError, match="not finite"):
        points_from_bytes(data)


@pytest.mark.parametrize("region", [-1, -7, 5_000])
def test_regions_of_no_sample_are_refused(records, region):
    points, regions = _points(records[0])
    broken = regions.copy()
    broken[3] = region
    with pytest.raises(BadRecordError):
        points_row_of(points, broken, DEFAULT)
