"""Locks on archive files: services share them, and a restoration needs one exclusively.

A second lock names the process that serves an archive, so that another one does not begin unasked.

SQLite's own locks cannot tell whether a service runs, because it holds none between transactions. The lock is
on a file beside the archive. The file remains; the operating system releases the lock when a process ends.
"""

import fcntl
import os
from pathlib import Path
from typing import Self

from service.errors import ArchiveServedError, StorageUnavailableError

LOCK_SUFFIX = "-lock"
SERVING_SUFFIX = "-serving"


class ArchiveLock:
    """A lock on an archive file, from the construction of the object to `release`.

    Parameters
    ----------
    path : Path
        The file of the archive, which may be missing; its folder must exist.
    alone : bool
        Whether the lock is exclusive.

    Raises
    ------
    StorageUnavailableError
        Another process holds a lock that excludes this one, or the lock file cannot be created.
    """

    def __init__(self, path: Path, *, alone: bool = False) -> None:
        path = path.resolve()
        try:
            self._descriptor = os.open(
                path.with_name(path.name + LOCK_SUFFIX), os.O_RDONLY | os.O_CREAT, 0o644
            )
        except OSError as error:
            raise StorageUnavailableError(f"the archive's lock cannot be made: {error.strerror}") from error
        try:
            fcntl.flock(self._descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._descriptor)
            who = "a service, or a command, is using it" if alone else "another is being put in its place"
            raise StorageUnavailableError(f"the archive cannot be used now: {who}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the lock; call this once."""
        os.close(self._descriptor)


class ServingLock:
    """The lock of the one process that serves an archive file, from construction to `release`.

    Its file names the process. It remains; the operating system releases the lock when the process ends.

    Parameters
    ----------
    path : Path
        The file of the archive, which may be missing, as may its folder.
    address : str
        The address of the service, for the message of another one.

    Raises
    ------
    ArchiveServedError
        Another process serves the archive; the message names it.
    StorageUnavailableError
        The lock file cannot be created.
    """

    def __init__(self, path: Path, address: str) -> None:
        path = path.resolve()
        beside = path.with_name(path.name + SERVING_SUFFIX)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(beside, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise StorageUnavailableError(f"the archive's lock cannot be made: {error.strerror}") from error
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = os.pread(self._descriptor, 200, 0).decode(errors="replace").strip()
            os.close(self._descriptor)
            raise ArchiveServedError(f"{path} is already served by {owner or 'another process'}") from error
        os.truncate(self._descriptor, 0)
        os.pwrite(self._descriptor, f"process {os.getpid()} at {address}\n".encode(), 0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the lock; call this once."""
        os.close(self._descriptor)
