"""The database: what is written survives, what fails is said, and what is newer is left alone."""

import logging
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from alembic.migration import MigrationContext
from sqlalchemy import inspect, select, text
from sqlalchemy.exc import IntegrityError

from service.errors import ArchiveTooNewError, StorageUnavailableError
from service.storage.database import Database, migrate
from service.storage.tables import ArchiveRow, BlobRow, EmbeddingRow, MetadataRow, ShapeRow, Table
from tests.service.engines import POSTGRESQL, SQLITE, empty_database, on_both, url_in

pytestmark = on_both


@pytest.fixture
def url(tmp_path: Path, engine: str) -> str:
    """The address of a database that is empty."""
    return url_in(tmp_path) if engine == SQLITE else empty_database()


@pytest.fixture
def database(url: str) -> Iterator[Database]:
    database = Database(url, lock_seconds=0.3)
    migrate(database)
    yield database
    database.close()


def add_blob(database: Database, name: str) -> None:
    with database.write() as session:
        session.add(BlobRow(sha256=name, size=10, data=bytes(10)))


def blobs(database: Database) -> list[str]:
    with database.read() as session:
        return list(session.scalars(select(BlobRow.sha256).order_by(BlobRow.number)))


def test_an_empty_database_gets_the_tables_and_the_version_of_the_code(
    database: Database, engine: str
) -> None:
    index = {SQLITE: "shapes_by_metadata", POSTGRESQL: "shapes_by_metadata_value"}[engine]
    with database.connect() as connection:
        assert MigrationContext.configure(connection).get_current_heads() == ("0001",)
        inspector = inspect(connection)
        assert set(inspector.get_table_names()) - {"alembic_version"} == set(Table.metadata.tables)
        assert [each["name"] for each in inspector.get_indexes("shape_metadata")] == [index]


def test_another_database_is_left_as_it_is(url: str) -> None:
    database = Database(url, lock_seconds=0.3)
    with database.connect() as connection:
        connection.execute(text("CREATE TABLE shapes (number INTEGER)"))
    with pytest.raises(StorageUnavailableError):
        migrate(database)
    with database.connect() as connection:
        assert inspect(connection).get_table_names() == ["shapes"]
    database.close()


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


def test_references_are_enforced(database: Database) -> None:
    with pytest.raises(IntegrityError), database.write() as session:
        session.add(
            EmbeddingRow(
                blob_number=7,
                format="off",
                fingerprint="f",
                signature=np.zeros(3, np.float32),
                record=b"",
                checksum="",
            )
        )


def test_writers_of_one_process_wait_for_each_other(database: Database, url: str) -> None:
    patient = Database(url, lock_seconds=20)

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


def test_a_writer_in_this_process_that_does_not_end_is_said(database: Database) -> None:
    with database.write(), pytest.raises(StorageUnavailableError, match="other writes"):
        add_blob(database, "a")
    add_blob(database, "a")


def test_a_signature_comes_back_bit_for_bit(database: Database) -> None:
    signature = np.random.default_rng(0).normal(size=37).astype(np.float32)
    # The least and the largest numbers there are, and the zero below zero.
    signature[:4] = np.finfo(np.float32).smallest_subnormal, np.finfo(np.float32).max, -0.0, 1 / 3
    with database.write() as session:
        blob = BlobRow(sha256="a", size=1, data=b"x")
        session.add(blob)
        session.flush()
        session.add(
            EmbeddingRow(
                blob_number=blob.number,
                format="off",
                fingerprint="f",
                signature=signature,
                record=b"",
                checksum="",
            )
        )
    with database.read() as session:
        (back,) = session.scalars(select(EmbeddingRow.signature))
        assert session.scalars(select(ArchiveRow.revision)).one() == 0
    assert back.dtype == np.float32
    assert back.tobytes() == signature.tobytes()


def test_a_failure_is_logged_without_what_was_asked(
    database: Database, caplog: pytest.LogCaptureFixture
) -> None:
    statement, values = text("SELECT no_column FROM blobs WHERE sha256 = :value"), {"value": "xyzzy"}
    with pytest.raises(StorageUnavailableError), database.read() as session:
        session.execute(statement, values)
    (record,) = [record for record in caplog.records if record.message == "the database failed"]
    logged = logging.Formatter().format(record)
    assert "no_column" in logged
    assert "WHERE sha256" not in logged
    assert "xyzzy" not in logged


@pytest.mark.parametrize(
    "value", ["", "\0", "\\", "\\0", "\\\0", "\\\\0\0", "a\0b", "x" * 16_000, "\U0001f600" * 4_000]
)
def test_any_text_is_kept_and_found(database: Database, value: str) -> None:
    now = datetime.now(UTC)
    with database.write() as session:
        session.add(BlobRow(number=1, sha256="a", size=1, data=b"x"))
        session.flush()
        columns = {
            "collection_number": 1,
            "format": "off",
            "folded_name": "",
            "meta": {"key": value},
            "facts": {},
            "revision": 1,
            "checksum": "",
        }
        for number in (1, 2):
            times = {"created_at": now, "updated_at": now}
            session.add(
                ShapeRow(number=number, id=str(number), blob_number=1, name=str(number), **columns, **times)
            )
        session.flush()
        session.add(MetadataRow(shape_number=1, key="key\0\\", value=value))
        session.add(MetadataRow(shape_number=2, key="key", value=value + "\0"))
    with database.read() as session:
        (row,) = session.scalars(select(MetadataRow).where(MetadataRow.value == value))
        assert (row.shape_number, row.key, row.value) == (1, "key\0\\", value)
        assert session.scalars(select(ShapeRow.meta)).all() == [{"key": value}] * 2
        assert session.scalar(select(ShapeRow.number).where(ShapeRow.id == "1\0")) is None
        assert session.scalars(select(ShapeRow.created_at).where(ShapeRow.id == "1")).one() == now
