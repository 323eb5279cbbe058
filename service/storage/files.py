"""Files that outlast a loss of power, and the errors of their disk."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from service.errors import StorageFullError, StorageUnavailableError


@contextmanager
def disk_errors(failed: str) -> Iterator[None]:
    """Raise an error of the service, with a message and the reason, for an error of the system in the block.

    Raise StorageFullError if the disk has no room, and StorageUnavailableError if the disk fails otherwise.
    """
    try:
        yield
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT}:
            raise StorageFullError(f"{failed}: {error.strerror}") from error
        raise StorageUnavailableError(f"{failed}: {error.strerror}") from error


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, if they are missing, durably across a loss of power."""
    if folder.is_dir():
        return
    make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    _sync(folder.parent)


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
