"""The members of a zip file, by its directory."""

import stat
import zipfile
from collections.abc import Container, Iterator

from service.errors import ServiceError
from service.jobs.errors import (
    ArchiveTooLargeError,
    MalformedArchiveError,
    MemberDamagedError,
    MemberEncryptedError,
    MemberError,
    MemberKindError,
    MemberTooLargeError,
)
from service.jobs.members import PIECE, ArchiveLimits, Fault, Listing, Member, Readable, describe

ENTRY_BYTES = 512
"""What one member may take in the directory, on average: three times what most take."""

LEAST_DIRECTORY_BYTES = 1024 * 1024

# The library unpacks the others without a limit on what comes out at a time, and lzma also on memory.
METHODS = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
ENCRYPTED = 0x1 | 0x40 | 0x2000


class Bounded:
    """A file of which little is read at a time: the library reads the whole directory at once.

    `taken` counts the bytes that were read.
    """

    def __init__(self, file: Readable, most: int) -> None:
        self._file = file
        self._most = most
        self._size = file.seek(0, 2)
        self.taken = 0

    def read(self, size: int = -1) -> bytes:
        """So many bytes, or all that are left."""
        if size < 0:
            size = max(0, self._size - self._file.tell())
        if size > self._most:
            raise ArchiveTooLargeError("its directory is longer than so many members need")
        data = self._file.read(size)
        self.taken += len(data)
        return data

    def seek(self, position: int, whence: int = 0) -> int:
        """Go to a place."""
        return self._file.seek(position, whence)

    def tell(self) -> int:
        """The place."""
        return self._file.tell()

    def seekable(self) -> bool:
        """Whether it has places."""
        return True


def list_zip(file: Readable, limits: ArchiveLimits) -> Listing:
    """All members, by the directory alone: no more can be read of any than it says there.

    Raises
    ------
    ArchiveTooLargeError
    """
    try:
        _, _, infos = _opened(file, limits)
    except MalformedArchiveError as error:
        return Listing([], error)
    members: list[Member] = []
    taken: set[str] = set()
    total = 0
    for place, info in infos:
        member, plain = describe(place, info.orig_filename, taken, _fault(info, limits))
        members.append(member)
        if plain is not None:
            taken.add(plain)
        total += info.file_size if member.fault is None else 0
    if total > limits.total_bytes:
        raise ArchiveTooLargeError(f"it unpacks to {total} bytes, more than {limits.total_bytes}")
    return Listing(members, None)


def read_zip(
    file: Readable, limits: ArchiveLimits, wanted: Container[int]
) -> Iterator[tuple[int, bytes | Fault]]:
    """The bytes of the wanted members in their order, or why there are none."""
    try:
        archive, bounded, infos = _opened(file, limits)
    except MalformedArchiveError:
        return
    for place, info in infos:
        if place in wanted:
            try:
                yield place, _unpacked(archive, bounded, info, limits)
            except MemberError as error:
                yield place, error


def _opened(
    file: Readable, limits: ArchiveLimits
) -> tuple[zipfile.ZipFile, Bounded, list[tuple[int, zipfile.ZipInfo]]]:
    """The archive, and its members but folders with their places."""
    bounded = Bounded(file, max(LEAST_DIRECTORY_BYTES, ENTRY_BYTES * limits.members))
    try:
        archive = zipfile.ZipFile(bounded)
    except ServiceError:
        raise
    # What strangers write into a directory brings the library to raise anything.
    except Exception as error:
        raise MalformedArchiveError(f"the archive's directory cannot be read: {error}") from error
    infos = archive.infolist()
    if len(infos) > limits.members:
        raise ArchiveTooLargeError(f"it has {len(infos)} members, more than {limits.members}")
    return archive, bounded, list(enumerate(info for info in infos if not info.is_dir()))


def _unpacked(
    archive: zipfile.ZipFile, bounded: Bounded, info: zipfile.ZipInfo, limits: ArchiveLimits
) -> bytes:
    """The bytes of a member, counted as they come."""
    data = bytearray()
    before = bounded.taken
    try:
        with archive.open(info) as opened:
            while piece := opened.read(PIECE):
                data += piece
                limits.check_member(len(data))
                limits.check_ratio(len(data), bounded.taken - before)
    except ServiceError:
        raise
    except Exception as error:
        raise MemberDamagedError(f"it cannot be unpacked: {error}") from error
    if len(data) != info.file_size:
        raise MemberDamagedError("it has fewer bytes than the directory says")
    return bytes(data)


def _fault(info: zipfile.ZipInfo, limits: ArchiveLimits) -> Fault | None:
    """What is wrong with a member by the directory."""
    kind = stat.S_IFMT(info.external_attr >> 16)
    if stat.S_ISLNK(kind):
        return MemberKindError("it is a link")
    if kind and not stat.S_ISREG(kind):
        return MemberKindError("it is no plain file")
    if info.flag_bits & ENCRYPTED:
        return MemberEncryptedError("it is encrypted")
    if info.compress_type not in METHODS:
        return MemberKindError("it is packed in a way that is not read; deflate is, and no packing at all")
    try:
        limits.check_member(info.file_size)
    except MemberTooLargeError as error:
        return error
    return None
