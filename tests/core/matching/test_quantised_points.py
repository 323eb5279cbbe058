"""Embedded points in bytes and back: the error, the exactness of rounded points, and bad bytes."""

import numpy as np
import pytest

from core.matching.kernels.points import points_of
from core.matching.quantised_points import decoded_points, encoded_points, quantised_points, rounded
from tests.core.matching.clouds import random_embedding

CASES = [(100, 500, 10), (60, 60, 3), (45, 91, 7), (300, 301, 2), (12, 12, 1)]


def points(m, d, k):
    embedding = random_embedding(m, m, d, k)
    return np.concatenate([one.coordinates for one in embedding.spectra], axis=1), embedding.regions


@pytest.mark.parametrize(("m", "d", "k"), CASES)
def test_samples_beside_other_points_keep_14_bits_and_offsets_6(m, d, k):
    coordinates, regions = points(m, d, k)
    found, of_sample = decoded_points(encoded_points(coordinates, regions))
    assert found.dtype == np.float32
    assert np.array_equal(of_sample, regions)
    errors = np.abs(found - coordinates)
    if d == m:
        assert not errors.any()
    assert (errors[:m] <= np.abs(coordinates[:m]).max(axis=0) * 2.0**-14).all()
    # An offset is taken from the rounded sample, and no finer than it.
    offsets = np.abs(coordinates[m:] - coordinates[:m][regions[m:]])
    assert (errors[m:] <= 2.0**-6 * offsets.max(axis=0, initial=0.0) + errors[:m].max(axis=0)).all()


@pytest.mark.parametrize(("m", "d", "k"), CASES)
@pytest.mark.parametrize("scale", [1.0, 1e-30, 3e20])
def test_rounded_points_come_back_exactly(m, d, k, scale):
    coordinates, regions = points(m, d, k)
    coordinates[:, 0] *= np.float32(scale)
    coordinates[m:, -1] = coordinates[:m, -1][regions[m:]]
    once = rounded(coordinates, regions)
    assert np.array_equal(rounded(once, regions), once)
    assert encoded_points(once, regions) == encoded_points(coordinates, regions)


def test_points_at_one_place_stay_there():
    nothing = np.zeros((9, 4), np.float32)
    assert not rounded(nothing, np.arange(9, dtype=np.int32) % 5).any()


@pytest.mark.parametrize(("m", "d", "k"), CASES)
def test_the_kernel_reads_the_same_points(m, d, k):
    data = quantised_points(random_embedding(m, m, d, k))
    assert len(data) % 4 == 0
    for found, expected in zip(
        points_of(np.frombuffer(data, np.uint8), 2 * k), decoded_points(data), strict=True
    ):
        assert np.array_equal(found, expected)


def with_number(data, place, number):
    return data[: 4 * place] + np.array([number]).tobytes() + data[4 * place + 4 :]


def test_samples_alone_have_no_units():
    data = quantised_points(random_embedding(1, 10, 10, 2))
    others = with_number(data, 3, np.float32(2.0**99))
    expected, _ = decoded_points(data)
    for found, _ in (decoded_points(others), points_of(np.frombuffer(others, np.uint8), 4)):
        assert np.array_equal(found, expected)


def test_other_bytes_are_refused():
    data = quantised_points(random_embedding(1, 10, 30, 2))
    for bad in (b"", b"no", data[:-1], data[:-4], data + bytes(4), bytes(len(data))):
        with pytest.raises(ValueError, match=r"bytes|buffer|points"):
            decoded_points(bad)
    for place, number in ((0, 9), (1, 0), (1, -1), (1, 31), (2, 0), (2, 5), (0, 2**31 - 1)):
        with pytest.raises(ValueError, match=r"bytes|points"):
            decoded_points(with_number(data, place, np.int32(number)))
    for place, value in ((3, np.nan), (6, np.inf), (7, -np.inf), (10, 3e38)):
        with pytest.raises(ValueError, match="not finite"):
            decoded_points(with_number(data, place, np.float32(value)))
    alone = quantised_points(random_embedding(1, 10, 10, 2))
    with pytest.raises(ValueError, match="not finite"):
        decoded_points(with_number(alone, 3 + 8 + 5, np.float32(np.nan)))
    with pytest.raises(ValueError, match="out of range"):
        decoded_points(with_number(data, 3 + 8 + 20, np.int32(10)))
