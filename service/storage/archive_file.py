"""The file of an archive, opened past the service: for checking, copying and putting back."""

import os
import sqlite3
from pathlib import Path

from service.errors import ArchiveError
from service.storage.migrate import check_known

# Beside the file there may be what SQLite needs to make it whole after a process was killed.
JOURNALS = ("-journal", "-wal")


def connect(path: Path, *, lock_seconds: float) -> sqlite3.Connection:
    """A bare connection to a file that is there; what a killed process left half done is rolled back.

    Raises
    ------
    ArchiveError
        There is no such file, or it is no database.
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
    """What SQLite says, with its name for it."""
    name = getattr(error, "sqlite_errorname", None)
    return f"{error} ({name})" if name else str(error)


def has_journal(path: Path) -> bool:
    """Whether something lies beside the file without which it is not whole."""
    beside = (path.with_name(path.name + ending) for ending in JOURNALS)
    return any(journal.is_file() and journal.stat().st_size > 0 for journal in beside)


def put_in_place(finished: Path, target: Path) -> None:
    """Give a finished file its name, in one step and for good: after a loss of power it is there whole."""
    _sync(finished)
    os.replace(finished, target)
    _sync(target.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
