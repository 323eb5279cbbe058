"""Who uses an archive: services share it, and a file is only put in its place while there are none.

SQLite's own locks do not tell: a service holds none between two transactions. The lock is on a file beside
the archive, which is left there; the system lets go of it when the process ends, however it ends.
"""

import fcntl
import os
from pathlib import Path
from typing import Self

from service.errors import StorageUnavailableError

ENDING = "-lock"


class ArchiveLock:
    """A hold on the archive in a file, from when it is made until it is released.

    Parameters
    ----------
    path : Path
        The archive's file, which need not be there yet; its folder must be.
    alone : bool
        Whether nobody else may use the archive meanwhile.

    Raises
    ------
    StorageUnavailableError
        Another process holds the archive, and one of both wants to be alone; or the lock cannot be made.
    """

    def __init__(self, path: Path, *, alone: bool = False) -> None:
        path = path.resolve()
        try:
            self._descriptor = os.open(path.with_name(path.name + ENDING), os.O_RDONLY | os.O_CREAT, 0o644)
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
        """Let go of it, once."""
        os.close(self._descriptor)
