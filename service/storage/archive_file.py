"""The SQLite file of an archive, opened without the service, to check, copy and restore it."""

import os
import sqlite3
from pathlib import Path

from service.errors import ArchiveError
from service.storage.migrate import check_known

# Files beside the database with which SQLite completes or rolls back an interrupted transaction.
JOURNALS = ("-journal", "-wal")


def connect(path: Path, *, lock_seconds: float) -> sqlite3.Connection:
    """A plain SQLite connection to an existing file; it rolls back transactions of killed processes.

    Raises
    ------
    ArchiveError
        The file is missing, or is not a database.
    """
    if not path.is_file():
        raise ArchiveError(f"there is no archive at {path}")
    try:
        connection = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=lock_seconds, isolation_level=None
        )
    except sqlite3.Error as error:
        raise ArchiveError(f"{path} cannot be opened: {reason(error)}") from error
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.Error as error:
        connection.close()
        raise ArchiveError(f"{path} cannot be read: {reason(error)}") from error
    return connection


def check_version(connection: sqlite3.Connection, path: Path) -> None:
    """Raise unless the file is an archive that this version of the service knows.

    Raises
    ------
    ArchiveError
    """
    try:
        versions = [row[0] for row in connection.execute("SELECT version_num FROM alembic_version")]
        connection.execute("SELECT revision FROM archive").fetchall()
    except sqlite3.Error as error:
        raise ArchiveError(f"{path} is no Isoshape archive: {reason(error)}") from error
    check_known(versions)


def reason(error: sqlite3.Error) -> str:
    """The message of an SQLite error with the name of its code."""
    name = getattr(error, "sqlite_errorname", None)
    return f"{error} ({name})" if name else str(error)


def has_journal(path: Path) -> bool:
    """Whether a non-empty journal is beside the file, without which the file is incomplete."""
    beside = (path.with_name(path.name + ending) for ending in JOURNALS)
    return any(journal.is_file() and journal.stat().st_size > 0 for journal in beside)


def put_in_place(finished: Path, target: Path) -> None:
    """Rename a finished file to its target, atomically and durably across a loss of power."""
    _sync(finished)
    os.replace(finished, target)
    _sync(target.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
