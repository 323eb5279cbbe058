"""Every hostile file over HTTP to a service that runs as a process of its own."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests.service.support import small_file, upload
from tests.soak.hostile.corpus import CORPUS
from tests.soak.hostile.serving import LIMIT_SECONDS, server
from tests.soak.hostile.uploading import memory_after, upload_each

PEAK = 4096.0
# MiB in one round. The processes that read are replaced after a hundred files, and so are at another age
# after each round.
GROWTH = {"service": 16.0, "workers": 64.0}


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, httpx.Client]]:
    with server(tmp_path_factory.mktemp("hostile")) as running:
        yield running


def test_each_is_answered_as_it_must_be_within_limits(running: tuple[int, httpx.Client]) -> None:
    pid, client = running
    outcomes = upload_each(pid, client, CORPUS)
    assert [
        (each.case.filename, each.status, each.kind, each.case.kind) for each in outcomes if not each.right
    ] == []
    assert max(each.seconds for each in outcomes) < LIMIT_SECONDS
    assert max(each.peak for each in outcomes) < PEAK
    assert client.get("/shapes").json()["total"] == 0
    assert upload(client, small_file(0), "after.off").status_code == 201


def test_memory_stays_flat(running: tuple[int, httpx.Client]) -> None:
    pid, client = running
    cases = [case for case in CORPUS if not case.slow]
    first, *later = memory_after(pid, client, cases, 3)
    # A leak shows in every round; the age of the processes that read in one.
    assert min(memory.service for memory in later) - first.service < GROWTH["service"]
    assert min(memory.workers for memory in later) - first.workers < GROWTH["workers"]
    # It was the service that was looked at, and processes of its own.
    assert first.service > 50
    assert first.workers > 50


def test_nothing_was_written_beside_the_archive(tmp_path: Path) -> None:
    """By files whose names are paths, or that name others."""
    with server(tmp_path) as (_, client):
        before = set(tmp_path.rglob("*"))
        for case in CORPUS:
            if case.row in {"name", "reference"}:
                client.post("/shapes", files={"file": (case.filename, case.make())})
        names = {path.name for path in set(tmp_path.rglob("*")) - before}
        assert names <= {"archive.sqlite3-journal", "archive.sqlite3-wal", "archive.sqlite3-shm"}
