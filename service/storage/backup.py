"""An archive copied while it is used, and a copy put back.

Files, embeddings and records are all in the one database, so that a copy of it is a copy of everything.
Either way the copy is made under another name, checked in full, synced, and then given its name in one step:
what was there before stays until a whole one replaces it.
"""

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from service.errors import ArchiveError
from service.storage.archive_file import JOURNALS, check_version, connect, has_journal, put_in_place, reason
from service.storage.checking import Report, check
from service.storage.lock import ArchiveLock

# Not the service's own patience: a copy made at night may wait for a busy moment to pass.
LOCK_SECONDS = 60.0


def back_up(archive: Path, target: Path, *, replace: bool = False) -> Report:
    """Copy the archive into a file, while services read and write it.

    The copy is of one moment. With a rollback journal, writers wait while the rows are copied (not while the
    copy is checked).

    Parameters
    ----------
    archive, target : Path
    replace : bool
        Whether a file that is there already may be replaced.

    Returns
    -------
    Report
        Of the copy.

    Raises
    ------
    ArchiveError
        There is no archive, the target is there or cannot be written, or the copy is not whole.
    """
    with closing(connect(archive, lock_seconds=LOCK_SECONDS)) as connection, _beside(target) as copy:
        check_version(connection, archive)
        if target.exists() and os.path.samefile(archive, target):
            raise ArchiveError(f"{target} is the archive itself")
        if target.exists() and not replace:
            raise ArchiveError(f"{target} is there already")
        try:
            connection.execute("VACUUM INTO ?", (str(copy),))
        except sqlite3.Error as error:
            raise ArchiveError(f"{archive} cannot be copied: {reason(error)}") from error
        report = _checked(copy, "the copy")
        put_in_place(copy, target)
    return report


def restore(backup: Path, archive: Path, *, replace: bool = False) -> Report:
    """Put a backup in the place of an archive that no process is using.

    An older one is brought up to date when a service starts on it.

    Parameters
    ----------
    backup, archive : Path
    replace : bool
        Whether an archive that holds shapes, or a file that is none, may be replaced.

    Returns
    -------
    Report
        Of the restored archive.

    Raises
    ------
    ArchiveError
        The backup is not whole, or something is in its place.
    StorageUnavailableError
        A service uses the archive.
    """
    if not backup.is_file():
        raise ArchiveError(f"there is no backup at {backup}")
    if has_journal(backup):
        raise ArchiveError(
            f"{backup} is a database in use, or a part of one; `isoshape backup` copies it whole"
        )
    archive.parent.mkdir(parents=True, exist_ok=True)
    with ArchiveLock(archive, alone=True), _beside(archive) as copy:
        if archive.exists() and os.path.samefile(backup, archive):
            raise ArchiveError(f"{backup} is the archive itself")
        if not replace and _holds_something(archive):
            raise ArchiveError(f"{archive} is not empty")
        shutil.copyfile(backup, copy)
        report = _checked(copy, str(backup))
        if archive.exists():
            _belong_alike(copy, archive)
        _settle(archive)
        put_in_place(copy, archive)
    return report


@contextmanager
def _beside(target: Path) -> Iterator[Path]:
    """An empty file in the same folder, readable to its owner alone; gone at the end unless renamed."""
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".partial", dir=target.parent)
    except OSError as error:
        raise ArchiveError(f"{target.parent} cannot be written: {error.strerror}") from error
    os.close(descriptor)
    copy = Path(name)
    try:
        yield copy
    except OSError as error:
        raise ArchiveError(f"{target} cannot be written: {error.strerror}") from error
    finally:
        for ending in ("", *JOURNALS, "-shm"):
            copy.with_name(copy.name + ending).unlink(missing_ok=True)


def _checked(copy: Path, name: str) -> Report:
    report = check(copy, lock_seconds=LOCK_SECONDS)
    if report.faults:
        raise ArchiveError(f"{name} is not whole: {'; '.join(report.faults)}")
    return report


def _holds_something(archive: Path) -> bool:
    """Whether the file holds shapes, or anything that is no archive."""
    if not archive.exists() or archive.stat().st_size == 0:
        return False
    try:
        with closing(connect(archive, lock_seconds=LOCK_SECONDS)) as connection:
            return connection.execute("SELECT 1 FROM shapes LIMIT 1").fetchone() is not None
    except (ArchiveError, sqlite3.Error):
        return True


def _belong_alike(copy: Path, archive: Path) -> None:
    """Give the copy the rights, and where that is allowed the owner, of what it replaces."""
    before = archive.stat()
    with suppress(PermissionError):
        os.chown(copy, before.st_uid, before.st_gid)
    shutil.copymode(archive, copy)


def _settle(archive: Path) -> None:
    """Leave no journal that SQLite would play into the file that takes the archive's place."""
    if has_journal(archive):
        with suppress(ArchiveError, sqlite3.Error), closing(connect(archive, lock_seconds=0)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for ending in (*JOURNALS, "-shm"):
        archive.with_name(archive.name + ending).unlink(missing_ok=True)
