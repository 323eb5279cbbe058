"""SQLite engines: their options, locks and journals."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from sqlite3 import sqlite_version_info
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, make_url
from sqlalchemy.engine import URL

from service.errors import ArchiveError, StorageUnavailableError

WRITES = "isoshape_writes"


def path_of(url: str) -> Path:
    """Return the file that an SQLAlchemy URL of SQLite names.

    Raises
    ------
    ArchiveError
        The URL names a PostgreSQL database.
    """
    named = make_url(url)
    if named.get_backend_name() != "sqlite":
        raise ArchiveError(
            f"{named.render_as_string(hide_password=True)} is no file: pg_dump and pg_restore copy it and "
            "put it back, and `isoshape copy` makes a file of it, which `isoshape check` reads"
        )
    assert named.database is not None
    return Path(named.database)


def open_sqlite(url: URL, *, lock_seconds: float) -> Engine:
    """Return an engine on an SQLite file; a missing folder is created.

    A connection with the execution option `WRITES` begins its transactions with BEGIN IMMEDIATE, which takes
    the write lock. A read transaction that asks for the lock later may fail at once, whatever the time limit,
    because two readers that both want to write can never wait for each other. Without a write-ahead log, any
    other transaction takes the read lock at its beginning: SQLite would take it at the first statement, and a
    thread that reads first while it holds a lock of the service could wait for a writer, the writer for
    another reader, and that reader for the lock.
    """
    if url.database is not None:
        try:
            Path(url.database).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageUnavailableError(f"the folder of the database cannot be made: {error}") from error
    # With isolation_level None the driver begins no transactions; the listener `_begin` does.
    engine = create_engine(
        url,
        connect_args={"timeout": lock_seconds, "isolation_level": None},
        pool_size=8,
        hide_parameters=True,
        max_overflow=64,
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


@contextmanager
def without_references(connection: Connection) -> Iterator[None]:
    """Disable foreign keys of a connection outside a transaction, until the end of the block.

    SQLite alters a table by creating a new one and dropping the old one. With foreign keys enabled, the drop
    deletes all rows that refer to it (sqlite.org/lang_altertable.html, "Making Other Kinds Of Table Schema
    Changes").
    """
    _execute(connection, "PRAGMA foreign_keys = OFF")
    try:
        yield
    finally:
        _execute(connection, "PRAGMA foreign_keys = ON")


def _execute(connection: Connection, pragma: str) -> None:
    """Execute a pragma without SQLAlchemy, whose transaction would make the pragma ineffective."""
    cursor = connection.connection.cursor()
    cursor.execute(pragma)
    cursor.close()


def write_ahead_log_is_safe(version: tuple[int, int, int]) -> bool:
    """Return whether several connections can safely use a write-ahead log in this version of SQLite.

    Versions 3.7.0 to 3.51.2 may corrupt the log (sqlite.org/wal.html, "The WAL-reset bug"), except 3.44.6,
    3.50.7 and later releases of these two series.
    """
    repaired = {(3, 44): 6, (3, 50): 7}
    series = version[:2]
    return version >= (3, 51, 3) or (series in repaired and version[2] >= repaired[series])


def journal_mode() -> str:
    """Return the journal mode for the linked version of SQLite.

    "truncate" is safer than "delete": with synchronous FULL the truncation is synced before a commit returns,
    so that acknowledged data survive a loss of power.
    """
    return "wal" if write_ahead_log_is_safe(sqlite_version_info[:3]) else "truncate"


def _prepare(connection: Any, _record: object) -> None:  # noqa: ANN401
    cursor = connection.cursor()
    cursor.execute("PRAGMA foreign_keys = ON")
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.execute(f"PRAGMA journal_mode = {journal_mode()}")
    cursor.close()


def _begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
    # With a write-ahead log, readers and writers do not wait for each other.
    if not writes and journal_mode() != "wal":
        connection.exec_driver_sql("SELECT 1 FROM sqlite_master LIMIT 1")
