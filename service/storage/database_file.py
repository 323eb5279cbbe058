"""The SQLite file under a running service: whether it is still there and writable, and room for deletions."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from service.errors import StorageUnavailableError

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
            found = self._path.stat()
        except OSError as error:
            raise StorageUnavailableError("the file of the database is gone") from error
        identity = found.st_dev, found.st_ino
        if self._identity is None:
            self._identity = identity
        elif self._identity != identity:
            raise StorageUnavailableError("another file is in the place of the database")
        if writable and not os.access(self._path, os.W_OK):
            raise StorageUnavailableError("the file of the database cannot be written: SQLITE_READONLY")

    @contextmanager
    def room_to_delete(self) -> Iterator[None]:
        """Release the reserve for the duration of the block if the disk is full."""
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
