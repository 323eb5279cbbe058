"""The database: what is written survives, what fails is said, and what is newer is left alone."""

import logging
import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import select, text
from sqlalchemy.exc import IntegrityError

from service.errors import ArchiveTooNewError, StorageFullError, StorageUnavailableError
from service.storage.database import Database
from service.storage.migrate import migrate
from service.storage.sqlite import journal_mode, write_ahead_log_is_safe
from service.storage.tables import ArchiveRow, BlobRow, EmbeddingRow, Table


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a folder" / "that is not there" / "archive.sqlite3"


@pytest.fixture
def database(path: Path) -> Iterator[Database]:
    database = open_database(path)
    migrate(database)
    yield database
    database.close()


def open_database(path: Path, lock_seconds: float = 0.3) -> Database:
    return Database(f"sqlite:///{path}", lock_seconds=lock_seconds)


def add_blob(database: Database, name: str, size: int = 10) -> None:
    with database.write() as session:
        session.add(BlobRow(sha256=name, size=size, data=bytes(size)))


def blobs(database: Database) -> list[str]:
    with database.read() as session:
        return list(session.scalars(select(BlobRow.sha256).order_by(BlobRow.number)))


def test_migrations_make_the_tables_that_the_code_has(database: Database) -> None:
    with database.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Table.metadata) == []


def test_migrating_again_changes_nothing(database: Database) -> None:
    add_blob(database, "a")
    migrate(database)
    assert blobs(database) == ["a"]


def test_a_newer_database_is_refused_and_left_as_it_is(database: Database) -> None:
    add_blob(database, "a")
    with database.connect() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(ArchiveTooNewError, match=r"9999.*newer"):
        migrate(database)
    with database.connect() as connection:
        assert connection.execute(text("SELECT version_num FROM alembic_version")).scalar_one() == "9999"
    assert blobs(database) == ["a"]


def test_a_write_is_committed_whole_or_not_at_all(database: Database) -> None:
    def fail_after_writing() -> None:
        with database.write() as session:
            session.add(BlobRow(sha256="a", size=1, data=b"x"))
            session.flush()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_after_writing()
    assert blobs(database) == []


def test_a_read_keeps_nothing(database: Database) -> None:
    with database.read() as session:
        session.add(BlobRow(sha256="a", size=1, data=b"x"))
        session.flush()
    assert blobs(database) == []


def test_connections_are_set_up_to_lose_nothing(database: Database) -> None:
    with database.read() as session:
        connection = session.connection()
        said = {
            pragma: connection.execute(text(f"PRAGMA {pragma}")).scalar_one()
            for pragma in ("foreign_keys", "synchronous", "journal_mode", "busy_timeout")
        }
    assert said == {"foreign_keys": 1, "synchronous": 2, "journal_mode": journal_mode(), "busy_timeout": 300}


def test_references_are_enforced(database: Database) -> None:
    with pytest.raises(IntegrityError), database.write() as session:
        session.add(
            EmbeddingRow(
                blob_number=7, format="off", fingerprint="f", signature=np.zeros(3, np.float32), record=b""
            )
        )


@pytest.mark.parametrize(
    ("version", "safe"),
    [
        ((3, 40, 1), False),
        ((3, 44, 5), False),
        ((3, 44, 6), True),
        ((3, 45, 0), False),
        ((3, 46, 1), False),
        ((3, 50, 6), False),
        ((3, 50, 7), True),
        ((3, 51, 2), False),
        ((3, 51, 3), True),
        ((3, 52, 0), True),
        ((4, 0, 0), True),
    ],
)
def test_the_write_ahead_log_is_used_only_where_it_is_sound(
    version: tuple[int, int, int], safe: bool
) -> None:
    assert write_ahead_log_is_safe(version) is safe


def test_writers_of_one_process_wait_for_each_other(database: Database, path: Path) -> None:
    patient = open_database(path, lock_seconds=20)

    def write(number: int) -> None:
        for i in range(10):
            add_blob(patient, f"{number} {i}")

    threads = [threading.Thread(target=write, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    patient.close()
    assert len(blobs(database)) == 80


def test_a_lock_that_another_holds_is_waited_for_and_then_said(database: Database, path: Path) -> None:
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(StorageUnavailableError, match="SQLITE_BUSY"):
        add_blob(database, "a")
    other.execute("COMMIT")
    other.close()
    add_blob(database, "a")


def test_a_writer_in_this_process_that_does_not_end_is_said(database: Database) -> None:
    with database.write(), pytest.raises(StorageUnavailableError, match="other writes"):
        add_blob(database, "a")
    add_blob(database, "a")


def test_a_full_disk_is_said_and_recovered_from(path: Path) -> None:
    database = open_database(path)
    migrate(database)
    with database.read() as session:
        connection = session.connection()
        pages = connection.execute(text("PRAGMA page_count")).scalar_one()
        connection.execute(text(f"PRAGMA max_page_count = {pages + 4}"))
    with pytest.raises(StorageFullError):
        add_blob(database, "large", 10_000_000)
    assert blobs(database) == []
    add_blob(database, "small")
    assert blobs(database) == ["small"]
    database.close()


def test_a_database_that_cannot_be_written_is_said(database: Database) -> None:
    with database.read() as session:
        session.execute(text("PRAGMA query_only = ON"))
    with pytest.raises(StorageUnavailableError, match="SQLITE_READONLY"):
        add_blob(database, "a")
    database.ping()


def test_a_file_that_is_no_database_is_said(tmp_path: Path) -> None:
    path = tmp_path / "archive.sqlite3"
    path.write_bytes(b"this is no database at all, however long it may be" * 100)
    database = open_database(path)
    with pytest.raises(StorageUnavailableError, match="SQLITE_NOTADB"):
        migrate(database)
    with pytest.raises(StorageUnavailableError):
        database.ping()
    database.close()


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageUnavailableError, match="folder"):
        open_database(tmp_path / "file" / "archive.sqlite3")


def test_a_signature_comes_back_bit_for_bit(database: Database) -> None:
    signature = np.random.default_rng(0).normal(size=37).astype(np.float32)
    with database.write() as session:
        blob = BlobRow(sha256="a", size=1, data=b"x")
        session.add(blob)
        session.flush()
        session.add(
            EmbeddingRow(
                blob_number=blob.number, format="off", fingerprint="f", signature=signature, record=b""
            )
        )
    with database.read() as session:
        (back,) = session.scalars(select(EmbeddingRow.signature))
        assert session.scalars(select(ArchiveRow.revision)).one() == 0
    assert back.dtype == np.float32
    np.testing.assert_array_equal(back, signature)


def test_a_failure_is_logged_without_what_was_asked(
    database: Database, caplog: pytest.LogCaptureFixture
) -> None:
    statement, values = text("SELECT no_column FROM blobs WHERE sha256 = :value"), {"value": "xyzzy"}
    with pytest.raises(StorageUnavailableError), database.read() as session:
        session.execute(statement, values)
    (record,) = [record for record in caplog.records if record.message == "the database failed"]
    logged = logging.Formatter().format(record)
    assert "no such column" in logged
    assert "WHERE sha256" not in logged
    assert "xyzzy" not in logged
