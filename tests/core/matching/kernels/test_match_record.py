"""A match record as one array, and many of them scored in one call."""

from itertools import product

import numpy as np
import pytest

from core.matching.kernels.match_record import decoded
from core.matching.match_records import embedding_key, keyed_match_record, score_match_records
from core.matching.procrustes import ProcrustesMatcher
from core.parameters import DEFAULT
from tests.core.matching.clouds import parameters_for, random_embedding
from tests.core.matching.reference import encoded_reference, match_record_reference

K = DEFAULT.spectral.dimensions
SIZES = [(100, 500), (60, 60), (100, 300), (45, 91), (33, 40), (12, 12)]


@pytest.fixture(scope="module")
def prepared():
    """Match records of shapes of any number of samples."""
    made = [random_embedding(seed, m, d) for seed, (m, d) in enumerate(SIZES)]
    return [ProcrustesMatcher(DEFAULT).prepare(one, embedding_key(one)) for one in made]


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "d"), SIZES)
@pytest.mark.parametrize("k", [2, 5, 10])
def test_a_match_record_holds_the_whole_shape(k, m, d, blocks):
    embedding, parameters = random_embedding(k, m, d, k, blocks), parameters_for(k)
    key = embedding_key(embedding)
    record = keyed_match_record(embedding, key, parameters)
    shape = match_record_reference(embedding, key, parameters)
    assert record.dtype == np.float32
    assert record.tobytes() == encoded_reference(shape).tobytes()
    for array, expected in zip(decoded(record.copy()), shape, strict=True):
        assert array.dtype == expected.dtype
        assert array.flags.c_contiguous
        assert np.array_equal(array, expected)


def test_the_match_record_of_a_full_shape_is_less_than_30_000_bytes():
    embedding = random_embedding(1, 100, 500)
    assert keyed_match_record(embedding, bytes(16), DEFAULT).nbytes < 30_000


def test_many_are_matched_as_one_by_one_whichever_is_the_query(prepared):
    found = [score_match_records(record, prepared, DEFAULT) for record in prepared]
    for i, j in product(range(len(prepared)), repeat=2):
        expected = ProcrustesMatcher(DEFAULT).match(prepared[i], prepared[j])
        assert (found[i].cc[j], found[i].ssd[j], found[i].sim[j]) == (expected.cc, expected.ssd, expected.sim)
        assert found[i].cc[j] == found[j].cc[i]
    for i in range(len(prepared)):
        assert (found[i].cc[i], found[i].ssd[i], found[i].sim[i]) == (1.0, 0.0, 1.0)


def test_match_records_of_another_type_are_refused(prepared):
    with pytest.raises(TypeError, match="float64"):
        score_match_records(prepared[0], [np.zeros(len(prepared[1]))], DEFAULT)


def test_match_records_of_any_layout_and_number_and_read_only_ones_are_scored(prepared):
    many = [np.repeat(record, 2)[::2] for record in prepared] * 12
    query = prepared[0].copy()
    for record in (query, *many):
        record.flags.writeable = False
    found = score_match_records(query, many, DEFAULT)
    expected = score_match_records(prepared[0], prepared, DEFAULT)
    assert np.array_equal(found.cc, np.tile(expected.cc, 12))
    assert np.array_equal(found.sim, np.tile(expected.sim, 12))
