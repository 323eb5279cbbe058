"""The options of SQLite, and where it is not trusted."""

import sqlite3
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text

from service.errors import StorageUnavailableError
from service.storage import sqlite
from service.storage.database import Database, migrate
from service.storage.sqlite import journal_mode, write_ahead_log_is_safe
from tests.service.support import wait_until


def open_database(path: Path) -> Database:
    return Database(f"sqlite:///{path}", lock_seconds=0.3)


def test_connections_are_set_up_to_lose_nothing(tmp_path: Path) -> None:
    database = open_database(tmp_path / "archive.sqlite3")
    with database.read() as session:
        connection = session.connection()
        said = {
            pragma: connection.execute(text(f"PRAGMA {pragma}")).scalar_one()
            for pragma in ("foreign_keys", "synchronous", "journal_mode", "busy_timeout")
        }
    assert said == {"foreign_keys": 1, "synchronous": 2, "journal_mode": journal_mode(), "busy_timeout": 300}
    database.close()


def test_no_reader_waits_for_a_writer_while_it_holds_a_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a rollback journal a writer that commits waits for older readers, and new readers wait for it."""
    monkeypatch.setattr(sqlite, "journal_mode", lambda: "truncate")
    path = tmp_path / "archive.sqlite3"
    database = Database(f"sqlite:///{path}", lock_seconds=3)
    migrate(database)
    read = text("SELECT revision FROM archive")
    lock = threading.Lock()

    def new_readers_wait() -> bool:
        with closing(sqlite3.connect(path, timeout=0)) as connection:
            try:
                connection.execute(str(read))
            except sqlite3.OperationalError:
                return True
        return False

    def write() -> None:
        with database.write() as session:
            session.execute(text("UPDATE archive SET revision = revision + 1"))

    def read_with_the_lock() -> None:
        with database.read() as session, lock:
            session.execute(read)

    with ThreadPoolExecutor(2) as others:
        with database.read() as session:
            session.execute(read)
            writer = others.submit(write)
            wait_until(new_readers_wait, seconds=2)
            newer = others.submit(read_with_the_lock)
            time.sleep(0.5)
            with lock:
                session.execute(read)
        writer.result()
        newer.result()
    database.close()


@pytest.mark.parametrize(
    ("version", "safe"),
    [
        ((3, 40, 1), False),
        ((3, 44, 5), False),
        ((3, 44, 6), True),
        ((3, 45, 0), False),
        ((3, 50, 6), False),
        ((3, 50, 7), True),
        ((3, 51, 2), False),
        ((3, 51, 3), True),
        ((4, 0, 0), True),
    ],
)
def test_the_write_ahead_log_is_used_only_where_it_is_sound(
    version: tuple[int, int, int], safe: bool
) -> None:
    assert write_ahead_log_is_safe(version) is safe


def test_a_file_that_is_no_database_is_said(tmp_path: Path) -> None:
    path = tmp_path / "archive.sqlite3"
    path.write_bytes(b"this is no database at all, however long it may be" * 100)
    database = open_database(path)
    with pytest.raises(StorageUnavailableError, match="SQLITE_NOTADB"):
        migrate(database)
    with pytest.raises(StorageUnavailableError):
        database.ping()
    database.close()


def test_the_folder_of_a_file_is_made_or_its_fault_said(tmp_path: Path) -> None:
    path = tmp_path / "a folder" / "that is not there" / "archive.sqlite3"
    open_database(path).close()
    assert path.parent.is_dir()
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageUnavailableError, match="folder"):
        open_database(tmp_path / "file" / "archive.sqlite3")
