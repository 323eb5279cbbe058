"""What a worker keeps of embeddings, and what it makes of a query."""

import numpy as np
import pytest

from core.matching.match_records import match_record
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.serialization import embedding_from_bytes
from service.search.worker_scoring import score_on_worker
from tests.service.archives import embedded

ROOM = 10**8
NUMBERS = np.arange(1, 6)


@pytest.fixture(scope="module")
def records() -> dict[int, bytes]:
    return {int(number): embedded(int(number)).record for number in NUMBERS}


def asked(numbers, records, user, room=ROOM):
    query = match_record(embedding_from_bytes(embedded(9).record), DEFAULT)
    return score_on_worker(query, np.array(numbers), records, DEFAULT, user, room)


def truth(records):
    candidates = [embedding_from_bytes(record) for record in records.values()]
    found = Pipeline(DEFAULT).score(embedding_from_bytes(embedded(9).record), candidates)
    return np.stack([found.cc, found.ssd, found.sim])


def test_a_worker_names_the_records_that_it_lacks_and_keeps_the_records_sent(records):
    scores, missing = asked(NUMBERS, {}, user=1)
    assert np.isnan(scores).all()
    np.testing.assert_array_equal(missing, NUMBERS)
    scores, missing = asked(NUMBERS, records, user=1)
    np.testing.assert_array_equal(scores, truth(records))
    assert len(missing) == 0
    again, missing = asked([5, 1, 7], {}, user=1)
    np.testing.assert_array_equal(again[:, :2], scores[:, [4, 0]])
    assert np.isnan(again[:, 2]).all()
    np.testing.assert_array_equal(missing, [7])


def test_the_numbers_of_several_services_are_their_own(records):
    asked([1], {1: records[1]}, user=2)
    assert asked([1], {}, user=3)[1].tolist() == [1]
    other, _ = asked([1], {1: records[2]}, user=3)
    mine, missing = asked([1], {}, user=2)
    assert missing.tolist() == []
    np.testing.assert_array_equal(mine, truth(records)[:, :1])
    np.testing.assert_array_equal(other, truth(records)[:, 1:2])


def test_a_record_without_room_is_matched_and_not_kept(records):
    length = match_record(embedding_from_bytes(records[1]), DEFAULT).nbytes
    scores, missing = asked(NUMBERS, records, user=4, room=2 * length + length // 2)
    np.testing.assert_array_equal(scores, truth(records))
    assert len(missing) == 0
    assert asked(NUMBERS, {}, user=4)[1].tolist() == [1, 2, 3]


def test_a_record_that_cannot_be_read_is_left_out(records):
    scores, missing = asked([1, 2], {1: b"spoilt", 2: records[2]}, user=5)
    assert np.isnan(scores[:, 0]).all()
    np.testing.assert_array_equal(scores[:, 1], truth(records)[:, 1])
    assert missing.tolist() == [1]
