"""A database that fails beneath the service: it says so, and goes on by itself once that is over."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import Connection, event, text

from service.storage.database import Database
from service.storage.postgresql import WRITERS_LOCK
from service.storage.sqlite import path_of
from tests.service.calls import assert_recovered, changes, reads, the_kept
from tests.service.engines import POSTGRESQL, SQLITE, bare, is_sqlite, on_both, url_of
from tests.service.support import Running, assert_problem, query, serving, settings_in, small_file, upload

PAGES = 1_000_000_000

_NO_ROOM = """
CREATE FUNCTION no_room() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'could not extend file: No space left on device' USING ERRCODE = 'disk_full';
END $$;
CREATE TRIGGER no_room BEFORE INSERT ON blobs FOR EACH ROW WHEN (NEW.size > 50000) EXECUTE FUNCTION no_room();
"""


@contextmanager
def lock_held(url: str, *, readers_too: bool = False) -> Iterator[None]:
    """Another client is in the middle of a write, or keeps even readers away."""
    if is_sqlite(url):
        with closing(sqlite3.connect(path_of(url), isolation_level=None)) as file:
            file.execute("BEGIN EXCLUSIVE" if readers_too else "BEGIN IMMEDIATE")
            yield
            file.execute("COMMIT")
        return
    with psycopg.connect(url.replace("+psycopg", "")) as client:
        client.execute("SELECT pg_advisory_xact_lock(%s)", [WRITERS_LOCK])
        if readers_too:
            client.execute("LOCK TABLE archive, blobs, shapes, embeddings IN ACCESS EXCLUSIVE MODE")
        yield


@contextmanager
def full(database: Database) -> Iterator[None]:
    """There is room for little more: not for a blob of more than 50,000 bytes."""
    url = url_of(database)
    if is_sqlite(url):
        with bare(url) as connection:
            pages = connection.exec_driver_sql("PRAGMA page_count").scalar_one()
        little, much = (f"PRAGMA max_page_count = {count}" for count in (pages + 4, PAGES))
        with in_each_transaction(database, little, much):
            yield
        return
    with bare(url) as connection:
        connection.exec_driver_sql(_NO_ROOM)
    try:
        yield
    finally:
        with bare(url) as connection:
            connection.exec_driver_sql("DROP FUNCTION no_room CASCADE")


@contextmanager
def not_writable(database: Database) -> Iterator[None]:
    """The database may be read, and not written."""
    if is_sqlite(url_of(database)):
        with in_each_transaction(database, "PRAGMA query_only = ON", "PRAGMA query_only = OFF"):
            yield
        return
    with in_each_transaction(database, "SET TRANSACTION READ ONLY", "SET TRANSACTION READ WRITE"):
        yield


@contextmanager
def in_each_transaction(database: Database, statement: str, afterwards: str) -> Iterator[None]:
    """Run a statement at the beginning of each transaction; and later another, which undoes it."""
    now = [statement]

    def run(connection: Connection) -> None:
        connection.exec_driver_sql(now[0])

    event.listen(database._engine, "begin", run)
    try:
        yield
    finally:
        now[0] = afterwards


on_sqlite = pytest.mark.parametrize("engine", [SQLITE], indirect=True, scope="module")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, engine: str) -> Path:
    return tmp_path_factory.mktemp(f"faults-{engine}")


@pytest.fixture(scope="module")
def frail(folder: Path, engine: str) -> Iterator[Running]:
    """A service with one worker that waits half a second for a lock."""
    with serving(settings_in(folder, workers=1, lock_seconds=0.5)) as running:
        running.store(small_file(0), "kept.off", name="kept")
        assert is_sqlite(url_of(running.container.database)) == (engine == SQLITE)
        yield running


@pytest.fixture
def kept(frail: Running) -> str:
    """The shape that is there all the time."""
    return the_kept(frail)


@on_both
def test_a_full_disk(frail: Running, kept: str) -> None:
    with full(frail.container.database):
        large = small_file(1) + b"\n" * 100_000
        problem = assert_problem(upload(frail.client, large, "large.off"), 507, "storage-full")
        assert "full" in problem["detail"]
        for call in reads(frail, kept).values():
            assert call().status_code == 200
        assert frail.client.get("/readyz").status_code == 200
    stored = upload(frail.client, large, "large.off")
    assert stored.status_code == 201
    assert frail.client.delete(f"/shapes/{stored.json()['id']}").status_code == 204
    assert_recovered(frail, kept)


@on_both
def test_a_database_that_may_not_be_written(frail: Running, kept: str, engine: str) -> None:
    said = {SQLITE: "SQLITE_READONLY", POSTGRESQL: "ReadOnlySqlTransaction"}[engine]
    with not_writable(frail.container.database):
        for call in changes(frail, kept).values():
            assert said in assert_problem(call(), 503, "storage-unavailable")["detail"]
        for call in reads(frail, kept).values():
            assert call().status_code == 200
        assert frail.client.get("/readyz").status_code == 200
    assert_recovered(frail, kept)


@on_sqlite
def test_a_folder_in_which_nothing_can_be_made(frail: Running, folder: Path, kept: str) -> None:
    """A journal must be made beside the database, and here something stands in its place."""
    journal = folder / "archive.sqlite3-journal"
    journal.unlink(missing_ok=True)
    journal.mkdir()
    for call in changes(frail, kept).values():
        assert_problem(call(), 503, "storage-unavailable")
    journal.rmdir()
    assert_recovered(frail, kept)


@on_both
def test_a_lock_that_another_process_holds(frail: Running, kept: str, engine: str) -> None:
    said = {SQLITE: "SQLITE_BUSY", POSTGRESQL: "LockNotAvailable"}[engine]
    url = url_of(frail.container.database)
    with lock_held(url):
        for call in changes(frail, kept).values():
            answer = call()
            assert said in assert_problem(answer, 503, "storage-unavailable")["detail"]
            assert int(answer.headers["retry-after"]) >= 1
        for call in reads(frail, kept).values():
            assert call().status_code == 200
    with lock_held(url, readers_too=True):
        for call in (changes(frail, kept) | reads(frail, kept)).values():
            assert_problem(call(), 503, "storage-unavailable")
        assert frail.client.get("/healthz").status_code == 200
        assert_problem(frail.client.get("/readyz"), 503, "not-ready")
    assert_recovered(frail, kept)


@on_both
def test_a_write_of_this_process_that_does_not_end(frail: Running, kept: str) -> None:
    with frail.container.database.write():
        for call in changes(frail, kept).values():
            assert_problem(call(), 503, "storage-unavailable")
        for call in reads(frail, kept).values():
            assert call().status_code == 200
        assert frail.client.get("/readyz").status_code == 200
    assert_recovered(frail, kept)


@on_both
def test_a_table_that_is_missing(frail: Running, kept: str) -> None:
    client, database = frail.client, frail.container.database
    with database.connect() as connection:
        connection.execute(text("ALTER TABLE archive RENAME TO hidden"))
    assert "OperationalError" not in client.get("/readyz").text
    assert_problem(client.get("/readyz"), 503, "not-ready")
    assert client.get("/healthz").status_code == 200
    answer = query(client, small_file(0))
    assert_problem(answer, 503, "storage-unavailable")
    assert str(database._engine.url.database) not in answer.text
    with database.connect() as connection:
        connection.execute(text("ALTER TABLE hidden RENAME TO archive"))
    assert_recovered(frail, kept)
