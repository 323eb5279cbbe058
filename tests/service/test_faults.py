"""What fails beneath the service: it says so, and goes on by itself once that is over."""

import os
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import httpx
import pytest
from sqlalchemy import Connection, event

from service.compute import work as work_module
from service.storage.checking import check
from tests.kill.cycles import runs
from tests.service.support import (
    Running,
    assert_problem,
    query,
    serving,
    settings_in,
    small_file,
    upload,
    wait_until,
)
from tests.service.tasks import nap_instead, run_out_of_memory

Calls = dict[str, Callable[[], httpx.Response]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("faults")


@pytest.fixture(scope="module")
def frail(folder: Path) -> Iterator[Running]:
    """A service with one worker that waits half a second for a lock."""
    with serving(settings_in(folder, workers=1, lock_seconds=0.5)) as running:
        running.store(small_file(0), "kept.off", name="kept")
        yield running


@pytest.fixture
def kept(frail: Running) -> str:
    """The shape that is there all the time."""
    (shape,) = frail.client.get("/shapes", params={"name": "kept"}).json()["shapes"]
    return str(shape["id"])


def changes(running: Running, shape_id: str) -> Calls:
    """Everything that writes. The upload needs no worker: its bytes are stored already."""
    return {
        "upload": lambda: upload(running.client, small_file(0), "again.off", name="again"),
        "change": lambda: running.client.patch(f"/shapes/{shape_id}", json={"tags": ["x"]}),
        "delete": lambda: running.client.delete(f"/shapes/{shape_id}"),
    }


def reads(running: Running, shape_id: str) -> Calls:
    """Everything that only reads. The query finds the shape itself."""
    by_id = {"shape_id": shape_id, "exclude_self": False}
    return {
        "list": lambda: running.client.get("/shapes"),
        "record": lambda: running.client.get(f"/shapes/{shape_id}"),
        "file": lambda: running.client.get(f"/shapes/{shape_id}/file"),
        "embedding": lambda: running.client.get(f"/shapes/{shape_id}/embedding"),
        "query": lambda: running.client.post("/query", json=by_id),
        "compare": lambda: running.client.post("/compare", json={"first": shape_id, "second": shape_id}),
    }


def assert_recovered(running: Running, folder: Path, shape_id: str) -> None:
    """The same process does everything again, and nothing is half done."""
    wait_until(lambda: running.client.get("/readyz").status_code == 200, seconds=60)
    for call in reads(running, shape_id).values():
        assert call().status_code == 200
    stored = upload(running.client, small_file(1), "new.off")
    assert stored.status_code == 201, stored.text
    assert running.client.delete(f"/shapes/{stored.json()['id']}").status_code == 204
    assert [shape["name"] for shape in running.client.get("/shapes").json()["shapes"]] == ["kept"]
    assert check(folder / "archive.sqlite3", lock_seconds=1).faults == []


@contextmanager
def in_each_transaction(running: Running, statement: str, afterwards: str) -> Iterator[None]:
    """Run a statement at the beginning of each transaction; and later another, which undoes it."""
    now = [statement]

    def run(connection: Connection) -> None:
        connection.exec_driver_sql(now[0])

    event.listen(running.parts.database._engine, "begin", run)
    try:
        yield
    finally:
        now[0] = afterwards


def test_a_full_disk(frail: Running, folder: Path, kept: str) -> None:
    with closing(sqlite3.connect(folder / "archive.sqlite3")) as connection:
        (pages,) = connection.execute("PRAGMA page_count").fetchone()
    full = in_each_transaction(
        frail, f"PRAGMA max_page_count = {pages + 1}", "PRAGMA max_page_count = 1000000000"
    )
    with full:
        large = small_file(1) + b"\n" * 100_000
        problem = assert_problem(upload(frail.client, large, "large.off"), 507, "storage-full")
        assert "full" in problem["detail"]
        for call in reads(frail, kept).values():
            assert call().status_code == 200
        assert frail.client.get("/readyz").status_code == 200
    stored = upload(frail.client, large, "large.off")
    assert stored.status_code == 201
    assert frail.client.delete(f"/shapes/{stored.json()['id']}").status_code == 204
    assert_recovered(frail, folder, kept)


def test_a_database_that_may_not_be_written(frail: Running, folder: Path, kept: str) -> None:
    with in_each_transaction(frail, "PRAGMA query_only = ON", "PRAGMA query_only = OFF"):
        for call in changes(frail, kept).values():
            problem = assert_problem(call(), 503, "storage-unavailable")
            assert "SQLITE_READONLY" in problem["detail"]
        for call in reads(frail, kept).values():
            assert call().status_code == 200
    assert_recovered(frail, folder, kept)


def test_a_folder_in_which_nothing_can_be_made(frail: Running, folder: Path, kept: str) -> None:
    """A journal must be made beside the database, and here something stands in its place."""
    journal = folder / "archive.sqlite3-journal"
    journal.unlink(missing_ok=True)
    journal.mkdir()
    for call in changes(frail, kept).values():
        assert_problem(call(), 503, "storage-unavailable")
    journal.rmdir()
    assert_recovered(frail, folder, kept)


def test_a_lock_that_another_process_holds(frail: Running, folder: Path, kept: str) -> None:
    with closing(sqlite3.connect(folder / "archive.sqlite3", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        for call in changes(frail, kept).values():
            answer = call()
            assert "SQLITE_BUSY" in assert_problem(answer, 503, "storage-unavailable")["detail"]
            assert int(answer.headers["retry-after"]) >= 1
        for call in reads(frail, kept).values():
            assert call().status_code == 200
        other.execute("COMMIT")
        other.execute("BEGIN EXCLUSIVE")
        for call in (changes(frail, kept) | reads(frail, kept)).values():
            assert_problem(call(), 503, "storage-unavailable")
        assert frail.client.get("/healthz").status_code == 200
        assert_problem(frail.client.get("/readyz"), 503, "not-ready")
        other.execute("COMMIT")
    assert_recovered(frail, folder, kept)


@pytest.mark.parametrize(
    ("task", "name"),
    [
        ("embed_mesh", "upload"),
        ("embed_mesh", "query"),
        ("score_records", "query"),
        ("match_records", "compare"),
    ],
)
def test_a_worker_that_is_killed(
    frail: Running, folder: Path, kept: str, monkeypatch: pytest.MonkeyPatch, task: str, name: str
) -> None:
    pool = frail.parts.pool
    wait_until(pool.pids, seconds=60)
    calls = reads(frail, kept) | {
        "upload": lambda: upload(frail.client, small_file(2), "lost.off"),
        **({"query": lambda: query(frail.client, small_file(2))} if task == "embed_mesh" else {}),
    }

    def kill() -> None:
        wait_until(pool.busy, seconds=60)
        os.kill(pool.pids()[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    with monkeypatch.context() as patch:
        patch.setattr(work_module, task, nap_instead)
        killer.start()
        assert_problem(calls[name](), 503, "worker-lost")
    killer.join()
    assert_recovered(frail, folder, kept)


@pytest.mark.parametrize(
    ("task", "name", "status", "kind"),
    [
        ("embed_mesh", "upload", 422, "mesh-too-complex"),
        ("score_records", "query", 503, "worker-lost"),
        ("match_records", "compare", 503, "worker-lost"),
    ],
)
def test_a_worker_without_memory(
    frail: Running,
    folder: Path,
    kept: str,
    monkeypatch: pytest.MonkeyPatch,
    task: str,
    name: str,
    status: int,
    kind: str,
) -> None:
    wait_until(frail.parts.pool.pids, seconds=60)
    before = frail.parts.pool.pids()
    calls = reads(frail, kept) | {"upload": lambda: upload(frail.client, small_file(2), "lost.off")}
    with monkeypatch.context() as patch:
        patch.setattr(work_module, task, run_out_of_memory)
        assert "memory" in assert_problem(calls[name](), status, kind)["detail"]
    assert frail.parts.pool.pids() == before
    assert_recovered(frail, folder, kept)


def test_workers_of_a_killed_process_end_in_the_middle_of_their_tasks() -> None:
    program = "from tests.service.tasks import serve_until_killed; serve_until_killed()"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        pids = [int(pid) for pid in process.stdout.readline().split()]
        assert len(pids) == 2
        assert all(runs(pid) for pid in pids)
        process.kill()
        wait_until(lambda: not any(runs(pid) for pid in pids), seconds=30)
