"""A shape as one row, and many such rows matched in one call."""

from itertools import product

import numpy as np
import pytest

from core.matching.kernels.match_record import ONE, opened, packed_row, row_at, unpacked
from core.matching.match_records import match_rows
from core.matching.matcher import embedding_key, match_prepared, prepare
from core.parameters import DEFAULT
from tests.core.matching.clouds import cloud, embedded, packed

K = DEFAULT.spectral.dimensions
SIZES = [(100, 500), (60, 60), (100, 300), (45, 91), (33, 40), (12, 12)]


@pytest.fixture(scope="module")
def prepared():
    """Shapes ready to be matched, of any number of samples."""
    made = []
    for seed, (m, d) in enumerate(SIZES):
        rng = np.random.default_rng(seed)
        one = embedded([cloud(rng, d, K) for _ in DEFAULT.spectral.operators], m)
        made.append(prepare(one, embedding_key(one), DEFAULT))
    return made


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "d"), SIZES)
@pytest.mark.parametrize("k", [2, 5, 10])
def test_a_row_holds_the_whole_shape(k, m, d, blocks):
    shape = packed(k, m, d, k, blocks)
    row = packed_row(shape)
    assert row.dtype == np.float32
    for array, expected in zip(unpacked(row), shape, strict=True):
        assert array.dtype == expected.dtype
        assert array.flags.c_contiguous
        assert np.array_equal(array, expected)


def test_of_a_full_shape_a_row_is_less_than_100_000_bytes():
    assert packed_row(packed(1, 100, 500, K, 2)).nbytes < 100_000


def test_a_spline_is_opened_as_it_was():
    whole = np.random.default_rng(1).integers(-ONE, ONE + 1, size=(30, 30)).astype(np.int16)
    assert opened(whole).dtype == np.float32
    assert opened(whole) == pytest.approx(whole / ONE, abs=1e-7)


def test_a_row_is_read_where_it_lies():
    row = np.arange(5, dtype=np.float32)
    assert np.array_equal(row_at(row.ctypes.data, 5), row)


def test_many_are_matched_as_one_by_one_whichever_is_the_query(prepared):
    rows = [one.shape for one in prepared]
    found = [match_rows(row, rows, DEFAULT) for row in rows]
    for i, j in product(range(len(rows)), repeat=2):
        expected = match_prepared(prepared[i], prepared[j], DEFAULT)
        assert (found[i].cc[j], found[i].ssd[j], found[i].sim[j]) == (expected.cc, expected.ssd, expected.sim)
        assert found[i].cc[j] == found[j].cc[i]
    for i in range(len(rows)):
        assert (found[i].cc[i], found[i].ssd[i], found[i].sim[i]) == (1.0, 0.0, 1.0)


def test_rows_that_cannot_be_written_to_are_matched_too(prepared):
    rows = [one.shape.copy() for one in prepared]
    expected = match_rows(rows[0], rows, DEFAULT).cc
    for row in rows:
        row.flags.writeable = False
    assert np.array_equal(match_rows(rows[0], rows, DEFAULT).cc, expected)


def test_no_rows_have_no_scores(prepared):
    assert match_rows(prepared[0].shape, [], DEFAULT).cc.shape == (0,)


@pytest.mark.parametrize("change", [lambda row: np.zeros(len(row)), lambda row: np.repeat(row, 2)[::2]])
def test_rows_of_another_kind_are_refused(prepared, change):
    with pytest.raises(ValueError, match="side by side"):
        match_rows(prepared[0].shape, [change(prepared[1].shape)], DEFAULT)
