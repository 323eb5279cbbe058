"""SQLite: the engines, and the file of an archive with its locks, journals and reserve of disk.

SQLite's own locks cannot tell whether a service runs, because it holds none between transactions. The locks
here are on files beside the archive: services share one, and a restoration needs it exclusively; a second one
names the process that serves the archive, so that another one does not begin unasked. The files remain; the
operating system releases the locks when a process ends.
"""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from sqlite3 import sqlite_version_info
from typing import Any, Self

from sqlalchemy import Connection, Engine, create_engine, event, make_url
from sqlalchemy.engine import URL

from service.errors import ArchiveError, ArchiveServedError, StorageUnavailableError
from service.storage.files import disk_errors, make_folder

WRITES = "isoshape_writes"


def path_of(url: str) -> Path:
    """Return the file that an SQLAlchemy URL of SQLite names.

    Raise ArchiveError if the URL names a PostgreSQL database.
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
        with disk_errors("the folder of the database cannot be made"):
            make_folder(Path(url.database).resolve().parent)
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
    # Without SQLAlchemy, whose transaction would make the pragmas ineffective.
    driver: Any = connection.connection.driver_connection
    driver.execute("PRAGMA foreign_keys = OFF")
    try:
        yield
    finally:
        driver.execute("PRAGMA foreign_keys = ON")


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
    connection.execute("PRAGMA foreign_keys = ON")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA journal_mode = {journal_mode()}")


def _begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
    # With a write-ahead log, readers and writers do not wait for each other.
    if not writes and journal_mode() != "wal":
        connection.exec_driver_sql("SELECT 1 FROM sqlite_master LIMIT 1")


class ArchiveLock:
    """The lock of a process that uses an archive, until `release`: shared or, with `alone`, exclusive.

    Raise StorageFullError or StorageUnavailableError if another process holds a lock that excludes this one,
    or the lock file cannot be created.
    """

    def __init__(self, archive: Path, *, alone: bool = False) -> None:
        operation = fcntl.LOCK_EX if alone else fcntl.LOCK_SH
        if not self._take(archive, "-lock", os.O_RDONLY, operation):
            self.release()
            who = "a service, or a command, is using it" if alone else "another is being put in its place"
            raise StorageUnavailableError(f"the archive cannot be used now: {who}")

    def _take(self, archive: Path, ending: str, flags: int, operation: int) -> bool:
        """Lock a file beside an archive, both of which may be missing; return whether that succeeds.

        The lock file is opened with `flags` (`os.open`) and locked by `operation` (`fcntl.flock`).
        """
        archive = archive.resolve()
        with disk_errors("the archive's lock cannot be made"):
            make_folder(archive.parent)
            self._descriptor = os.open(archive.with_name(archive.name + ending), flags | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._descriptor, operation | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the lock; call this once."""
        os.close(self._descriptor)


SERVING = "-serving"
"""The ending of the lock file of the process that serves an archive."""


class ServingLock(ArchiveLock):
    """The lock of the one process that serves an archive; its file names that process and its `address`.

    Raise ArchiveServedError if another process serves the archive; the message names it. Raise
    StorageFullError or StorageUnavailableError if the lock file cannot be created or written.
    """

    def __init__(self, archive: Path, address: str) -> None:
        if not self._take(archive, SERVING, os.O_RDWR, fcntl.LOCK_EX):
            owner = os.pread(self._descriptor, 200, 0).decode(errors="replace").strip()
            self.release()
            raise ArchiveServedError(f"{archive.resolve()} is already served by {owner or 'another process'}")
        try:
            with disk_errors("the archive's lock cannot be written"):
                os.truncate(self._descriptor, 0)
                os.pwrite(self._descriptor, f"process {os.getpid()} at {address}\n".encode(), 0)
        except BaseException:
            self.release()
            raise


def address_of_service(archive: Path) -> str | None:
    """Return the address of the service that has the lock of an archive; None if none has it."""
    archive = archive.resolve()
    try:
        descriptor = os.open(archive.with_name(archive.name + SERVING), os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return os.pread(descriptor, 200, 0).decode(errors="replace").rpartition(" at ")[2].strip()
    finally:
        os.close(descriptor)
    return None


# Files beside the database with which SQLite completes or rolls back an interrupted transaction.
JOURNALS = ("-journal", "-wal")


def has_journal(path: Path) -> bool:
    """Return whether a non-empty journal is beside the file, without which the file is incomplete."""
    beside = (path.with_name(path.name + ending) for ending in JOURNALS)
    return any(journal.is_file() and journal.stat().st_size > 0 for journal in beside)


RESERVE_BYTES = 2 * 1024**2
RESERVE_SUFFIX = "-reserve"


class DatabaseFile:
    """The file of an archive, and a reserve of disk beside it.

    SQLite writes the previous content of changed pages to a journal, so that a deletion needs room too. On a
    full disk a deletion has the room of the reserve, which the disk has if it `keeps_reserve`.
    """

    def __init__(self, path: Path, *, keeps_reserve: bool = True) -> None:
        self._path = path
        self._keeps_reserve = keeps_reserve
        self._reserve = path.with_name(path.name + RESERVE_SUFFIX)
        self._identity: tuple[int, int] | None = None

    def check(self, *, writable: bool = False) -> None:
        """Check that the file is the one of the first check and, if asked, writable.

        The file is not opened: closing it would release the locks of SQLite (fcntl of POSIX). A write to a
        file that is not writable would leave a journal that no reader can roll back. Raise
        StorageUnavailableError if the file was deleted or replaced, or cannot be written.
        """
        try:
            status = self._path.stat()
        except OSError as error:
            raise StorageUnavailableError("the file of the database is gone") from error
        identity = status.st_dev, status.st_ino
        if self._identity is None:
            self._identity = identity
        elif self._identity != identity:
            raise StorageUnavailableError("another file is in the place of the database")
        if writable and not os.access(self._path, os.W_OK):
            raise StorageUnavailableError("the file of the database cannot be written: SQLITE_READONLY")

    @contextmanager
    def room_to_delete(self) -> Iterator[None]:
        """Free the reserved space for the block if the disk is full, so that a deletion can be written."""
        released = False
        with suppress(OSError):
            if self._free() < RESERVE_BYTES:
                os.truncate(self._reserve, 0)
                released = True
        try:
            yield
        finally:
            # Its own room comes back to it, before another write takes it.
            self.keep_reserve(RESERVE_BYTES if released else 2 * RESERVE_BYTES)

    def keep_reserve(self, least: int = 2 * RESERVE_BYTES) -> None:
        """Occupy the reserve, if it is not there and the disk has `least` bytes free."""
        if not self._keeps_reserve:
            return
        with suppress(OSError):
            if self._reserve.exists() and self._reserve.stat().st_size >= RESERVE_BYTES:
                return
            if self._free() < least:
                return
            descriptor = os.open(self._reserve, os.O_WRONLY | os.O_CREAT, 0o600)
            try:
                # Systems without it write nothing that has to be occupied.
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(descriptor, 0, RESERVE_BYTES)
            finally:
                os.close(descriptor)

    def _free(self) -> int:
        return shutil.disk_usage(self._path.parent).free
