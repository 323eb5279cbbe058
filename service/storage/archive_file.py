"""The SQLite file of an archive: its locks, its journals, its replacement, and its reserve of disk.

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
from typing import Self

from service.errors import ArchiveServedError, StorageUnavailableError


class ArchiveLock:
    """The lock of a process that uses an archive, until `release`: shared or, with `alone`, exclusive.

    Raises
    ------
    StorageUnavailableError
        Another process holds a lock that excludes this one, or the lock file cannot be created.
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
        try:
            archive.parent.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(archive.with_name(archive.name + ending), flags | os.O_CREAT, 0o644)
        except OSError as error:
            raise StorageUnavailableError(f"the archive's lock cannot be made: {error.strerror}") from error
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


class ServingLock(ArchiveLock):
    """The lock of the one process that serves an archive; its file names that process and its `address`.

    Raises
    ------
    ArchiveServedError
        Another process serves the archive; the message names it.
    StorageUnavailableError
        The lock file cannot be created.
    """

    def __init__(self, archive: Path, address: str) -> None:
        if not self._take(archive, "-serving", os.O_RDWR, fcntl.LOCK_EX):
            owner = os.pread(self._descriptor, 200, 0).decode(errors="replace").strip()
            self.release()
            raise ArchiveServedError(f"{archive.resolve()} is already served by {owner or 'another process'}")
        os.truncate(self._descriptor, 0)
        os.pwrite(self._descriptor, f"process {os.getpid()} at {address}\n".encode(), 0)


# Files beside the database with which SQLite completes or rolls back an interrupted transaction.
JOURNALS = ("-journal", "-wal")


def has_journal(path: Path) -> bool:
    """Return whether a non-empty journal is beside the file, without which the file is incomplete."""
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


RESERVE_BYTES = 2 * 1024**2
RESERVE_SUFFIX = "-reserve"


class DatabaseFile:
    """The file of an archive, and a reserve of disk beside it.

    SQLite writes the previous content of changed pages to a journal, so that a deletion needs room too. On a
    full disk a deletion has the room of the reserve.

    Parameters
    ----------
    path : Path
    keeps_reserve : bool
        Whether the disk has a reserve.
    """

    def __init__(self, path: Path, *, keeps_reserve: bool = True) -> None:
        self._path = path
        self._keeps_reserve = keeps_reserve
        self._reserve = path.with_name(path.name + RESERVE_SUFFIX)
        self._identity: tuple[int, int] | None = None

    def check(self, *, writable: bool = False) -> None:
        """Check that the file is the one of the first check and, if asked, writable.

        The file is not opened: closing it would release the locks of SQLite (fcntl of POSIX). A write to a
        file that is not writable would leave a journal that no reader can roll back.

        Raises
        ------
        StorageUnavailableError
            The file was deleted or replaced, or cannot be written.
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
