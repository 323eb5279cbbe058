"""Bulk jobs over HTTP, on both engines: what is in an archive is stored, and what cannot be is named."""

import asyncio
import errno
import io
import os
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import uuid4

import pytest
from sqlalchemy import select, update
from starlette.concurrency import run_in_threadpool

from service.collection import DEFAULT_COLLECTION
from service.compute import request_queue, sandbox
from service.errors import StorageFullError, StorageUnavailableError, WorkerLostError
from service.jobs import endpoints
from service.jobs import service as jobs_service
from service.jobs.zip_archive import ArchiveTooLargeError, ZipArchive
from service.settings import Settings
from service.shapes import service as shapes_service
from service.storage.database import Database, WriteSession
from service.storage.tables import JobFileRow, JobRow
from tests.core.io.test_glb import BESIDE, BINARY
from tests.service.engines import on_both
from tests.service.jobs.support import (
    begun,
    causes,
    ended,
    events,
    files,
    job,
    meshes,
    pack,
    send,
    stored,
    zip_link,
    zipped,
)
from tests.service.support import Running, assert_problem, requests_at_work, small_file, wait_until


@pytest.fixture
def clean(service: Running) -> Running:
    """The shared service, holding neither shapes nor jobs."""
    for each in service.client.get("/jobs").json()["jobs"]:
        assert service.client.delete(f"/jobs/{each['id']}").status_code == 204
    service.clear()
    return service


def archives(running: Running) -> list[Path]:
    """Return the files in the folder of archives."""
    return list(jobs_service.folder_of(running.container.settings).glob("*"))


def test_a_gltf_is_stored_with_the_buffers_beside_it(clean: Running) -> None:
    files_of = {
        "chair/scene.gltf": BESIDE,
        "chair/a b.bin": BINARY,
        "chair/wood.png": b"\x89PNG",
        "b.bin": b"no",
    }
    done = ended(clean.client, begun(clean.client, pack(files_of)))
    assert done["counts"]["stored"] == 1
    (shape,) = clean.client.get("/shapes").json()["shapes"]
    assert (shape["name"], shape["format"], shape["facts"]["faces"]) == ("scene.gltf", "glb", 12)
    # The buffer is no member of its own.
    assert done["counts"]["files"] == 3
    # The same bytes by themselves, and as a single upload.
    bundle = clean.client.get(f"/shapes/{shape['id']}/file").content
    assert clean.store(bundle, "chair.zip")["facts"] == shape["facts"]


def test_every_mesh_of_an_archive_is_stored_as_an_upload_would_be(clean: Running) -> None:
    made = meshes(range(5))
    job_id = begun(clean.client, pack(made), name="parts.zip", tags="a,b", metadata='{"year": 2026}')
    done = ended(clean.client, job_id)
    assert (done["state"], done["archive"]) == ("done", "parts.zip")
    assert done["counts"] == {"files": 5, "waiting": 0, "stored": 5, "present": 0, "refused": 0, "ignored": 0}
    assert done["problem"] is None
    assert done["created_at"] <= done["started_at"] <= done["ended_at"]
    assert stored(clean) == {path.rpartition("/")[2]: data for path, data in made.items()}
    outcomes = files(clean.client, job_id)
    assert [file["position"] for file in outcomes] == list(range(5))
    assert [file["path"] for file in outcomes] == list(made)
    for file in outcomes:
        assert (file["outcome"], file["problem"]) == ("stored", None)
        shape = clean.client.get(f"/shapes/{file['shape_id']}").json()
        assert (shape["tags"], shape["metadata"]) == (["a", "b"], {"year": 2026})
        assert shape["name"] == file["path"].rpartition("/")[2]
        assert shape["embedded"]
    wait_until(lambda: not archives(clean), seconds=30)


@on_both
def test_files_that_cannot_be_stored_are_named_and_hold_up_nothing(clean: Running) -> None:
    good = small_file(0)
    members = [(zipfile.ZipInfo(name), data) for name, data in {
        "good/0.off": good,
        "cut.off": good[: len(good) // 2],
        "empty.stl": b"",
        "words.ply": b"hello",
        "notes.txt": b"hello",
        "../1.off": small_file(1),
        "inside.zip": pack({"2.off": small_file(2)}),
        "good/3.stl": small_file(3, "stl"),
    }.items()]  # fmt: skip
    members.insert(4, (zip_link("link.off"), b"/etc/passwd"))
    job_id = begun(clean.client, zipped(members))
    done = ended(clean.client, job_id)
    assert done["state"] == "done"
    assert done["counts"] == {"files": 9, "waiting": 0, "stored": 2, "present": 0, "refused": 7, "ignored": 1}
    assert causes(clean.client, job_id) == {
        "cut.off": "malformed-mesh",
        "empty.stl": "empty-file",
        "words.ply": "malformed-mesh",
        "link.off": "member-kind",
        "notes.txt": "unknown-format",
        "../1.off": "member-name",
        "inside.zip": "nested-archive",
    }
    assert all(file["problem"]["detail"] for file in files(clean.client, job_id, outcome="refused"))
    assert stored(clean) == {"0.off": good, "3.stl": small_file(3, "stl")}


@on_both
def test_a_shape_that_is_stored_already_is_found(clean: Running) -> None:
    shape = clean.store(small_file(0), "0.off", tags="before")
    data = pack({"a/0.off": small_file(0), "b/1.off": small_file(1), "c/1.off": small_file(1)})
    job_id = begun(clean.client, data, tags="after")
    assert ended(clean.client, job_id)["counts"]["stored"] == 1
    first, *others = files(clean.client, job_id)
    assert (first["outcome"], first["shape_id"]) == ("present", shape["id"])
    assert {file["outcome"] for file in others} == {"stored", "present"}
    assert len({file["shape_id"] for file in others}) == 1
    assert clean.client.get(f"/shapes/{shape['id']}").json()["tags"] == ["before", "after"]
    again = ended(clean.client, begun(clean.client, data))
    assert again["counts"] == {
        "files": 3,
        "waiting": 0,
        "stored": 0,
        "present": 3,
        "refused": 0,
        "ignored": 0,
    }


def test_an_archive_without_files(clean: Running) -> None:
    done = ended(clean.client, begun(clean.client, pack({})))
    assert (done["state"], done["counts"]["files"]) == ("done", 0)


@on_both
def test_an_archive_that_is_cut_or_gone_fails(clean: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    data = pack(meshes(range(3)))
    done = ended(clean.client, begun(clean.client, data[: len(data) // 2]))
    assert (done["state"], done["counts"]["files"]) == ("failed", 0)
    assert done["problem"]["type"].endswith(":malformed-archive")

    def lose(_file: object, path: Path) -> int:
        path.parent.mkdir(exist_ok=True)
        return len(data)

    monkeypatch.setattr(jobs_service, "_copy", lose)
    done = ended(clean.client, begun(clean.client, data))
    assert done["state"] == "failed"
    assert "ISOSHAPE_JOB_FOLDER" in done["problem"]["detail"]
    assert stored(clean) == {}


@pytest.mark.parametrize("archive", [b"", small_file(0), b"\x1f\x8b" + bytes(40)])
def test_bytes_that_are_no_archive_are_refused_at_once(clean: Running, archive: bytes) -> None:
    assert_problem(send(clean.client, archive), 415, "unknown-archive")
    assert clean.client.get("/jobs").json() == {"jobs": [], "total": 0, "next_cursor": None}
    assert archives(clean) == []


def test_fields_that_cannot_be_used(clean: Running) -> None:
    archive = pack(meshes(range(1)))
    for fields in ({"other": "x"}, {"metadata": "[]"}, {"tags": "x" * 65}, {"metadata": "{"}):
        assert_problem(send(clean.client, archive, **fields), 422, "bad-request-fields")
    assert_problem(clean.client.post("/jobs", json={}), 415, "unsupported-media-type")
    assert_problem(clean.client.post("/jobs", files={"other": archive}), 422, "bad-request-fields")
    assert clean.rows(JobRow) == 0


@on_both
def test_jobs_are_listed_the_latest_first(clean: Running) -> None:
    archive = pack({"0.off": small_file(0)})
    ids = [begun(clean.client, archive, name=f"{number}.zip") for number in range(5)]
    first = clean.client.get("/jobs", params={"limit": 2}).json()
    assert ([each["id"] for each in first["jobs"]], first["total"]) == (ids[:2:-1], 5)
    second = clean.client.get("/jobs", params={"limit": 3, "cursor": first["next_cursor"]}).json()
    assert ([each["id"] for each in second["jobs"]], second["next_cursor"]) == (ids[2::-1], None)
    for job_id in ids:
        ended(clean.client, job_id)
    taken = [job(clean.client, job_id)["started_at"] for job_id in ids]
    assert taken == sorted(taken)


def test_progress_as_events(clean: Running, held: threading.Event) -> None:
    job_id = begun(clean.client, pack(meshes(range(6))))
    wait_until(lambda: job(clean.client, job_id)["state"] == "running", seconds=180)
    address = f"/jobs/{job_id}/events"
    with clean.client.stream("GET", address) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        lines = answer.iter_lines()
        assert next(lines).startswith("retry: ")
        held.set()
        told = events(lines)
    assert [name for _, name, _ in told] == ["progress"] * (len(told) - 1) + ["end"]
    done = [data["counts"]["stored"] for _, _, data in told]
    assert done == sorted(done)
    assert (done[0], done[-1]) == (0, 6)
    assert told[-1][2] == job(clean.client, job_id)
    # A browser comes back by itself, and is told that there is nothing more.
    assert clean.client.get(address, headers={"last-event-id": told[-1][0]}).status_code == 204
    late = events(clean.client.get(address).text.splitlines())
    assert [(name, data["state"]) for _, name, data in late] == [("end", "done")]


def test_only_so_many_follow_at_a_time(
    clean: Running, held: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoints, "FOLLOWERS", 4)
    job_id = begun(clean.client, pack(meshes(range(2))))
    address = f"/jobs/{job_id}/events"

    def answered() -> int:
        with clean.client.stream("GET", address) as answer:
            return answer.status_code

    with clean.client.stream("GET", address) as one, clean.client.stream("GET", address) as other:
        # An iterator that is dropped would end its stream.
        lines = [one.iter_lines(), other.iter_lines()]
        assert [next(each) for each in lines] == ["retry: 2000"] * 2
        assert_problem(clean.client.get(address), 503, "busy")
    # Who has gone away is counted no longer.
    wait_until(lambda: answered() == 200, seconds=180)
    held.set()
    ended(clean.client, job_id)


@on_both
def test_rate_and_remaining_time(clean: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    job_id = begun(clean.client, pack(meshes(range(2))))
    ended(clean.client, job_id)
    start = datetime.now(UTC) - timedelta(seconds=100)
    with clean.container.database.write() as session:
        number = session.scalars(select(JobRow.number)).one()
        session.execute(
            update(JobRow).values(
                state="running", started_at=start, runner="x", leased_until=datetime(2999, 1, 1, tzinfo=UTC)
            )
        )
        session.execute(
            JobFileRow.__table__.insert(),
            [
                {"job_number": number, "position": 10 + i, "path": "x", "name": "x",
                 "outcome": "stored" if i < 50 else None,
                 "ended_at": start + timedelta(seconds=1 + i) if i < 50 else None}
                for i in range(250)
            ],
        )  # fmt: skip
        # The thirty that ended last took from the 22nd second on, of a hundred.
        session.execute(update(JobFileRow).where(JobFileRow.position < 10).values(ended_at=start))
    now = job(clean.client, job_id)
    assert now["counts"]["waiting"] == 200
    assert now["files_per_second"] == pytest.approx(30 / 80, rel=0.05)
    assert now["remaining_seconds"] == pytest.approx(200 * 80 / 30, rel=0.05)


def test_a_job_that_is_cancelled_stores_nothing_more(clean: Running, held: threading.Event) -> None:
    workers = clean.container.settings.workers
    job_id = begun(clean.client, pack(meshes(range(3, 9))))
    wait_until(lambda: at_work(clean) == workers, seconds=180)
    cancelled = clean.client.post(f"/jobs/{job_id}/cancel")
    assert cancelled.status_code == 200
    assert cancelled.json()["state"] == "cancelled"
    held.set()
    wait_until(lambda: at_work(clean) == 0, seconds=180)
    assert stored(clean) == {}
    assert {file["outcome"] for file in files(clean.client, job_id)} == {"cancelled"}
    wait_until(lambda: not archives(clean), seconds=30)
    # Again, it changes nothing; and the next job has its turn.
    assert clean.client.post(f"/jobs/{job_id}/cancel").json() == cancelled.json()
    assert ended(clean.client, begun(clean.client, pack(meshes(range(2)))))["counts"]["stored"] == 2


def at_work(running: Running) -> int:
    (line,) = [
        line
        for line in running.client.get("/metrics").text.splitlines()
        if line.startswith("isoshape_job_files ")
    ]
    return int(float(line.split()[1]))


def test_shapes_that_a_cancelled_job_has_stored_stay(clean: Running) -> None:
    job_id = begun(clean.client, pack(meshes(range(12))))
    wait_until(lambda: job(clean.client, job_id)["counts"]["stored"] >= 3, seconds=180)
    cancelled = clean.client.post(f"/jobs/{job_id}/cancel").json()
    wait_until(lambda: at_work(clean) == 0, seconds=180)
    counts = job(clean.client, job_id)["counts"]
    assert counts == cancelled["counts"]
    assert 3 <= counts["stored"] < 12
    there = stored(clean)
    assert len(there) == counts["stored"]
    assert {file["path"].rpartition("/")[2] for file in files(clean.client, job_id, outcome="stored")} == set(
        there
    )


@on_both
def test_a_job_that_is_deleted_is_cancelled_and_forgotten(clean: Running, held: threading.Event) -> None:
    job_id = begun(clean.client, pack(meshes(range(3, 9))))
    wait_until(lambda: at_work(clean), seconds=180)
    assert clean.client.delete(f"/jobs/{job_id}").status_code == 204
    held.set()
    wait_until(lambda: at_work(clean) == 0, seconds=180)
    for address in ("", "/files", "/events"):
        assert_problem(clean.client.get(f"/jobs/{job_id}{address}"), 404, "job-not-found")
    for method, address in (("POST", "/cancel"), ("DELETE", "")):
        assert_problem(clean.client.request(method, f"/jobs/{job_id}{address}"), 404, "job-not-found")
    assert stored(clean) == {}
    wait_until(lambda: not archives(clean), seconds=30)
    assert clean.rows(JobRow) == clean.rows(JobFileRow) == 0


def test_requests_come_before_files(clean: Running, held: threading.Event) -> None:
    job_id = begun(clean.client, pack(meshes(range(10, 16))))
    wait_until(lambda: at_work(clean) == clean.container.settings.workers, seconds=180)
    # The files wait to be stored, and no request for a worker.
    assert clean.client.post("/query", files={"file": ("x.off", small_file(30))}).status_code == 200
    assert clean.client.get("/readyz").status_code == 200
    assert job(clean.client, job_id)["counts"]["stored"] == 0
    held.set()
    assert ended(clean.client, job_id)["counts"]["stored"] == 6


def test_files_wait_while_requests_want_the_workers(clean: Running) -> None:
    with requests_at_work(clean, 2):
        job_id = begun(clean.client, pack(meshes(range(4))))
        wait_until(lambda: job(clean.client, job_id)["state"] == "running", seconds=180)
        wait_until(lambda: job(clean.client, job_id)["counts"]["stored"] >= 1, seconds=180)
        assert at_work(clean) <= 1
    assert ended(clean.client, job_id)["counts"]["stored"] == 4


def failing(monkeypatch: pytest.MonkeyPatch, number: int, *errors: Exception) -> None:
    """Have one small file fail to be stored so often, and each time so."""
    store, left = shapes_service._store, list(errors)

    def fail_or_store(*arguments: object) -> object:
        if left and arguments[2][0].data == small_file(number):  # type: ignore[attr-defined]
            raise left.pop(0)
        return store(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(shapes_service, "_store", fail_or_store)


@on_both
@pytest.mark.parametrize("error", [StorageFullError("full"), StorageUnavailableError("away")])
def test_the_job_waits_for_errors_that_are_no_fault_of_a_file(
    clean: Running, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    failing(monkeypatch, 1, error, error)
    done = ended(clean.client, begun(clean.client, pack(meshes(range(4)))))
    assert done["counts"] == {"files": 4, "waiting": 0, "stored": 4, "present": 0, "refused": 0, "ignored": 0}
    assert len(stored(clean)) == 4


def test_a_worker_that_is_lost_is_tried_again_once(clean: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, 1, WorkerLostError("killed"))
    assert ended(clean.client, begun(clean.client, pack(meshes(range(3)))))["counts"]["stored"] == 3
    clean.clear()
    failing(monkeypatch, 1, WorkerLostError("killed"), WorkerLostError("killed"))
    job_id = begun(clean.client, pack(meshes(range(3))))
    assert ended(clean.client, job_id)["counts"]["stored"] == 2
    assert causes(clean.client, job_id) == {"folder 1/1.off": "worker-lost"}


def test_a_fault_that_no_one_foresaw_is_one_files(clean: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, 2, ZeroDivisionError("a secret"), ZeroDivisionError("a secret"))
    job_id = begun(clean.client, pack(meshes(range(3))))
    assert ended(clean.client, job_id)["counts"]["stored"] == 2
    assert causes(clean.client, job_id) == {"folder 2/2.off": "internal-error"}
    assert "secret" not in clean.client.get(f"/jobs/{job_id}/files").text


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (ArchiveTooLargeError("the limits were lowered"), "archive-too-large"),
        (KeyError("x"), "internal-error"),
    ],
)
def test_a_job_that_cannot_be_gone_on_with_fails_and_the_next_has_its_turn(
    clean: Running, monkeypatch: pytest.MonkeyPatch, error: Exception, kind: str
) -> None:
    with monkeypatch.context() as patch:

        def fail(*_arguments: object) -> None:
            raise error

        patch.setattr(ZipArchive, "read", fail)
        job_id = begun(clean.client, pack(meshes(range(3))))
        failed = ended(clean.client, job_id)
    assert failed["state"] == "failed"
    assert failed["problem"]["type"].endswith(f":{kind}")
    assert {file["outcome"] for file in files(clean.client, job_id)} == {"cancelled"}
    wait_until(lambda: not archives(clean), seconds=30)
    assert ended(clean.client, begun(clean.client, pack(meshes(range(3)))))["counts"]["stored"] == 3


def test_the_directory_is_read_in_a_confined_process(clean: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_arguments: object) -> None:
        raise AssertionError("the serving process reads a directory")

    monkeypatch.setattr(sandbox, "zip_directory", fail)
    assert ended(clean.client, begun(clean.client, pack(meshes(range(2)))))["counts"]["stored"] == 2


def test_a_cancellation_waits_for_the_reading_of_a_member() -> None:
    """The file is closed after it; an error of the disk is not hidden by that of a generator at work."""
    go_on, ended_reading = threading.Event(), threading.Event()

    def read() -> None:
        go_on.wait()
        ended_reading.set()

    async def cancelled() -> None:
        reading = asyncio.create_task(request_queue.whole(run_in_threadpool(read)))
        await asyncio.sleep(0)
        reading.cancel()
        asyncio.get_running_loop().call_later(0.05, go_on.set)
        with pytest.raises(asyncio.CancelledError):
            await reading
        assert ended_reading.is_set()

    asyncio.run(cancelled())


@on_both
def test_leftovers_are_cleared(clean: Running) -> None:
    job_id = begun(clean.client, pack(meshes(range(1))))
    ended(clean.client, job_id)
    database, settings = clean.container.database, clean.container.settings
    jobs, folder = jobs_service.Jobs(database, settings), jobs_service.folder_of(settings)
    wait_until(lambda: not archives(clean), seconds=30)
    left, arriving, other = (folder / name for name in (f"{uuid4()}.zip", f"{uuid4()}.partial", "notes.zip"))
    for path in (left, arriving, other):
        path.touch()
    jobs.clear(timedelta(days=1))
    assert set(archives(clean)) == {left, arriving, other}
    hours_ago = time.time() - 2 * jobs_service.ORPHAN_SECONDS
    for path in (left, arriving, other):
        os.utime(path, (hours_ago, hours_ago))
    assert not jobs.clear(timedelta(days=1))
    assert archives(clean) == [other]
    other.unlink()
    with database.write() as session:
        session.execute(update(JobRow).values(ended_at=datetime.now(UTC) - timedelta(hours=25)))
    jobs.clear(timedelta(hours=26))
    assert job(clean.client, job_id)["state"] == "done"
    jobs.clear(timedelta(hours=24))
    assert_problem(clean.client.get(f"/jobs/{job_id}"), 404, "job-not-found")
    assert clean.rows(JobRow) == clean.rows(JobFileRow) == 0
    assert len(stored(clean)) == 1


@pytest.mark.parametrize(
    ("code", "error"), [(errno.ENOSPC, StorageFullError), (errno.EIO, StorageUnavailableError)]
)
def test_an_archive_that_cannot_be_written_is_no_job(
    clean: Running, code: int, error: type[Exception]
) -> None:
    class Broken(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            assert len(archives(clean)) == 1
            raise OSError(code, os.strerror(code))

    jobs = jobs_service.Jobs(clean.container.database, clean.container.settings)
    with pytest.raises(error):
        jobs.receive(Broken(), "", DEFAULT_COLLECTION.number, "a", (), {})
    assert archives(clean) == []
    assert clean.rows(JobRow) == 0


@on_both
def test_a_job_that_was_stored_by_a_transaction_that_failed_at_its_end_has_its_archive(
    clean: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = Database.write

    @contextmanager
    def stored_and_failed(database: Database) -> Iterator[WriteSession]:
        with write(database) as session:
            yield session
        raise StorageUnavailableError("SQLITE_IOERR_FSYNC")

    jobs = jobs_service.Jobs(clean.container.database, clean.container.settings)
    with monkeypatch.context() as patch:
        patch.setattr(Database, "write", stored_and_failed)
        with pytest.raises(StorageUnavailableError):
            jobs.receive(io.BytesIO(pack(meshes(range(1)))), "", DEFAULT_COLLECTION.number, "a", (), {})
    (listed,) = clean.client.get("/jobs").json()["jobs"]
    assert ended(clean.client, listed["id"])["counts"]["stored"] == 1


def test_a_disk_that_fails_holds_up_a_job_and_refuses_nothing(
    clean: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures = []
    open_file = Path.open

    def fail(*_arguments: object) -> None:
        failures.append(None)
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    class Failing(io.BytesIO):
        read = fail  # type: ignore[assignment]

    monkeypatch.setattr("service.jobs.runner.PAUSES", (0.01,))
    for failing in (fail, Failing):
        with monkeypatch.context() as patch:
            patch.setattr(
                Path, "open", lambda path, mode, f=failing: f() if mode == "rb" else open_file(path, mode)
            )
            before = len(failures)
            job_id = begun(clean.client, pack(meshes([before])))
            wait_until(lambda before=before: len(failures) > before + 4, seconds=60)
        assert ended(clean.client, job_id)["counts"]["stored"] == 1
    with monkeypatch.context() as patch:
        unlink = Path.unlink
        patch.setattr(
            Path, "unlink", lambda path, **named: fail() if path.suffix == ".zip" else unlink(path, **named)
        )
        job_id = begun(clean.client, pack(meshes(range(1))))
        assert ended(clean.client, job_id)["state"] == "done"
        assert clean.client.delete(f"/jobs/{job_id}").status_code == 204


def test_archives_are_beside_the_database_or_in_the_folder_of_the_settings(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/archive.sqlite3"
    assert jobs_service.folder_of(Settings(database_url=url)) == tmp_path / "archive.sqlite3-jobs"
    assert jobs_service.folder_of(Settings(database_url=url, job_folder="/x")) == Path("/x")
    other = Settings(database_url="postgresql+psycopg://host/archive")
    assert jobs_service.folder_of(other) == Path("isoshape-data/jobs")
