"""Backups of a running archive, and their restoration.

One database holds files, embeddings and records, so that its copy is complete. A backup and a restoration
write a copy under a temporary name, check and sync it, and rename it at the end: the previous file stays
until a complete one replaces it.
"""

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from service.errors import ArchiveError
from service.storage.checking import DAMAGED, CheckReport, check, check_version, connect, reason
from service.storage.files import put_in_place
from service.storage.sqlite import JOURNALS, ArchiveLock, has_journal

# Longer than the time limit of the service: a nightly backup may wait for a busy moment to pass.
LOCK_SECONDS = 60.0


def back_up(archive: Path, target: Path, *, replace: bool = False) -> CheckReport:
    """Copy a running archive into a file, which replaces another only if told so; return the copy's content.

    The copy shows one moment. With a rollback journal, writers wait while rows are copied, but not while the
    copy is checked. Raise ArchiveError if the archive is missing, the target exists or is not writable, or
    the copy is damaged.
    """
    with closing(connect(archive, lock_seconds=LOCK_SECONDS)) as connection, _beside(target) as copy:
        check_version(connection, archive)
        if target.exists() and os.path.samefile(archive, target):
            raise ArchiveError(f"{target} is the archive itself")
        if target.exists() and not replace:
            raise ArchiveError(f"{target} is there already")
        try:
            connection.execute("VACUUM INTO ?", (str(copy),))
        except DAMAGED as error:
            raise ArchiveError(f"{archive} cannot be copied: {reason(error)}") from error
        report = _checked(copy, "the copy")
        put_in_place(copy, target)
    return report


def restore(backup: Path, archive: Path, *, replace: bool = False) -> CheckReport:
    """Replace an archive that no process uses with a backup, and return the content of the backup.

    With `replace`, an archive with shapes, or a file of another kind, may be replaced. Raise ArchiveError if
    the backup is damaged, or the target is not empty, and StorageUnavailableError if a service uses the
    archive.
    """
    if not backup.is_file():
        raise ArchiveError(f"there is no backup at {backup}")
    if has_journal(backup):
        raise ArchiveError(
            f"{backup} is a database in use, or a part of one; `isoshape backup` copies it whole"
        )
    with ArchiveLock(archive, alone=True), _beside(archive) as copy:
        if archive.exists() and os.path.samefile(backup, archive):
            raise ArchiveError(f"{backup} is the archive itself")
        if not replace and _holds_something(archive):
            raise ArchiveError(f"{archive} is not empty")
        shutil.copyfile(backup, copy)
        report = _checked(copy, str(backup))
        if archive.exists():
            _copy_ownership(copy, archive)
        _remove_journals(archive)
        put_in_place(copy, archive)
    return report


@contextmanager
def _beside(target: Path) -> Iterator[Path]:
    """Create an empty file beside the target, readable by its owner only; removed unless renamed."""
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
            # A disk that fails leaves a part of a copy, whose name says so.
            with suppress(OSError):
                copy.with_name(copy.name + ending).unlink(missing_ok=True)


def _checked(copy: Path, name: str) -> CheckReport:
    report = check(copy, lock_seconds=LOCK_SECONDS)
    if report.faults:
        raise ArchiveError(f"{name} is not whole: {'; '.join(report.faults)}")
    return report


def _holds_something(archive: Path) -> bool:
    """Return whether the file has shapes, or is not an archive."""
    if not archive.exists() or archive.stat().st_size == 0:
        return False
    try:
        with closing(connect(archive, lock_seconds=LOCK_SECONDS)) as connection:
            return connection.execute("SELECT 1 FROM shapes LIMIT 1").fetchone() is not None
    except (ArchiveError, *DAMAGED):
        return True


def _copy_ownership(copy: Path, archive: Path) -> None:
    """Give the copy the mode and, if permitted, the owner of the archive that it replaces."""
    before = archive.stat()
    with suppress(PermissionError):
        os.chown(copy, before.st_uid, before.st_gid)
    shutil.copymode(archive, copy)


def _remove_journals(archive: Path) -> None:
    """Remove the journals of the replaced archive, which SQLite would apply to the new one.

    They are applied to the old archive first, unless it is no database: until it is replaced it stays whole.
    Raise ArchiveError if the disk fails.
    """
    if has_journal(archive):
        try:
            with closing(connect(archive, lock_seconds=0)) as connection:
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        except (ArchiveError, *DAMAGED) as error:
            if isinstance(error.__cause__ or error, sqlite3.OperationalError):
                raise ArchiveError(f"the journal of {archive} cannot be applied: {error}") from error
    for ending in (*JOURNALS, "-shm"):
        archive.with_name(archive.name + ending).unlink(missing_ok=True)
