"""The hostile files cover the table of threats, and each is answered by name of its cause; without HTTP."""

from collections import Counter

import pytest

from core.errors import CoreError
from core.io import DEFAULT_LIMITS, format_of
from core.parameters import DEFAULT
from service.compute.tasks import embed_file
from service.errors import PROBLEMS
from tests.core.io.files import PLAIN
from tests.soak.hostile.case import ROWS, Hostile
from tests.soak.hostile.corpus import CORPUS

# A name is looked at by the service, and a body's size.
OVER_HTTP = {"bad-request-fields", "body-too-large"}


def test_every_row_has_files_and_every_file_its_own_name() -> None:
    assert {case.row for case in CORPUS} == set(ROWS)
    assert len(CORPUS) >= 145
    assert [name for name, count in Counter(case.filename for case in CORPUS).items() if count > 1] == []


def test_every_format_has_hostile_files() -> None:
    endings = Counter(case.filename.rpartition(".")[2] for case in CORPUS)
    assert all(endings[format] >= 20 for format in PLAIN)
    assert endings["3mf"] >= 20
    assert endings["step"] >= 8
    assert all(endings[ending] >= 1 for ending in ("zip", "zae", "dae", "gz"))


def test_every_answer_is_one_that_the_service_has() -> None:
    for case in CORPUS:
        assert case.status == (PROBLEMS[case.kind].status if case.kind else 201), case.filename


@pytest.mark.parametrize("case", [case for case in CORPUS if not case.slow], ids=lambda case: case.filename)
def test_a_file_is_the_same_each_time_and_refused_by_its_cause_or_embedded(case: Hostile) -> None:
    data = case.make()
    assert case.make() == data
    if case.kind not in OVER_HTTP and not case.fatal:
        assert kind_of(data, case.filename) == case.kind


def kind_of(data: bytes, filename: str) -> str:
    """The kind of error that reading and embedding a file raises; "" if it is embedded."""
    try:
        embedded = embed_file(data, format_of(filename), DEFAULT_LIMITS, DEFAULT)
    except CoreError as error:
        return error.kind
    assert embedded.record
    return ""
