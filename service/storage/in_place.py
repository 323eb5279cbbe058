"""Files of sources, whose bytes stay in their folders: reading them without leaving the folder."""

import hashlib
import os
import stat
from pathlib import Path

from sqlalchemy import select

from service.errors import FileInPlaceError
from service.storage.checksums import whole_file
from service.storage.database import ReadSession
from service.storage.tables import SourceFileRow, SourceRow

_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
# Opening a pipe must not wait for its writer.
_FILE = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def open_folder(path: str, within: int | None = None) -> int:
    """Return a descriptor of a folder, by its name in another one or by its path; links are not followed."""
    return os.open(path, _FOLDER, dir_fd=within)


def open_beneath(root: Path, path: str) -> int:
    """Return a descriptor of a plain file of a folder. A link is followed to a file of the folder only.

    Raise OSError if there is no such file, or it cannot be opened.
    """
    real = Path(os.path.realpath(root / path))
    if not real.is_relative_to(root):
        raise PermissionError("a link leads out of the folder")
    folder = open_folder(str(root))
    try:
        # Each step refuses links: another process may put one in the place of a folder meanwhile.
        *folders, name = real.relative_to(root).parts or ("",)
        for part in folders:
            inner = open_folder(part, folder)
            os.close(folder)
            folder = inner
        file = os.open(name, _FILE, dir_fd=folder)
    finally:
        os.close(folder)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise PermissionError("not a plain file")
    return file


def is_in_source(session: ReadSession, sha256: str) -> bool:
    """Return whether a source, but for those that were removed, has a file with a SHA-256."""
    query = (
        select(SourceFileRow.number)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .where(SourceFileRow.sha256 == sha256, SourceRow.removed_at.is_(None))
    )
    return session.scalar(query.limit(1)) is not None


def stored_bytes(session: ReadSession, data: bytes | None, sha256: str) -> bytes:
    """Return the bytes of a blob, from the archive or else from a source that has them.

    Raise BadRecordError if the archive's bytes are damaged, and FileInPlaceError if no source has a file with
    the SHA-256.
    """
    if data is not None:
        return whole_file(data, sha256)
    places = session.execute(
        select(SourceRow.root, SourceFileRow.path)
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .where(SourceFileRow.sha256 == sha256)
        .order_by(SourceFileRow.number)
    )
    for root, path in places.all():
        try:
            with open(open_beneath(Path(root), path), "rb") as file:
                found = file.read()
        except OSError:
            continue
        if hashlib.sha256(found).hexdigest() == sha256:
            return found
    raise FileInPlaceError(
        "the file is not in its folder as it was read: the folder is offline, or the file was changed, moved "
        "or deleted; a rescan of its source finds out"
    )
