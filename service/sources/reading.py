"""Reading a file of a source whole, unless it is being written."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from service.errors import FileTooLargeError, ServiceError, StorageUnavailableError
from service.sources.walk import FoundFile, signed
from service.storage.in_place import open_beneath

QUIET_SECONDS = 2.0
"""A file that was written so recently may still grow."""


class FileUnreadableError(ServiceError, kind="file-unreadable"):
    """The system does not let the service read the file."""


class FileInMotionError(Exception):
    """The file is being written, or has changed since its folder was listed."""


def read_file(root: Path, found: FoundFile, most: int) -> bytes:
    """Return the bytes of a file of at most some bytes.

    Raises
    ------
    FileInMotionError
    FileTooLargeError
    FileUnreadableError
    """
    if found.size > most:
        raise FileTooLargeError(f"the file has {found.size} bytes; at most {most} bytes are taken")
    with opened(root, found) as file:
        data = file.read(found.size + 1)
        if len(data) != found.size:
            raise FileInMotionError
    return data


@contextmanager
def opened(root: Path, found: FoundFile) -> Iterator[BinaryIO]:
    """Open a file for reading, if it is at rest at the beginning and at the end of the block.

    Raises
    ------
    FileInMotionError
    FileUnreadableError
    """
    if abs(time.time_ns() - found.mtime_ns) < QUIET_SECONDS * 1e9:
        raise FileInMotionError
    try:
        with open(open_beneath(root, found.path), "rb") as file:
            if _state(file.fileno()) != found.same_bytes:
                raise FileInMotionError
            yield file
            if _state(file.fileno()) != found.same_bytes:
                raise FileInMotionError
    except FileNotFoundError as error:
        raise FileInMotionError from error
    except OSError as error:
        raise FileUnreadableError(error.strerror or str(error)) from error
    except StorageUnavailableError as error:
        raise FileUnreadableError(str(error)) from error


def _state(file: int) -> tuple[int, int, int]:
    about = os.fstat(file)
    return signed(about.st_ino), about.st_size, about.st_mtime_ns
