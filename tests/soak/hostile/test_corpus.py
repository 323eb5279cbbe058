"""The hostile files cover the table of threats."""

from collections import Counter

from service.errors import PROBLEMS
from tests.core.io.files import PLAIN
from tests.soak.hostile.case import ROWS
from tests.soak.hostile.corpus import CORPUS


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


def test_a_file_is_the_same_each_time() -> None:
    for case in CORPUS:
        if not case.slow:
            assert case.make() == case.make(), case.filename
