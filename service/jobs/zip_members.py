"""Members of zip archives, by the central directory."""

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
from service.jobs.members import (
    PIECE,
    ArchiveFile,
    ArchiveLimits,
    ArchiveMember,
    MemberFault,
    MemberList,
    describe,
)

ENTRY_BYTES = 512
"""The limit of the directory's size per member, three times the usual size."""

LEAST_DIRECTORY_BYTES = 1024 * 1024

# For other methods the library does not limit the size of the output, nor the memory of lzma.
METHODS = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
ENCRYPTED = 0x1 | 0x40 | 0x2000


class BoundedFile:
    """A file that limits the size of one read: the library reads the whole directory at once.

    `taken` counts the bytes that were read.
    """

    def __init__(self, file: ArchiveFile, most: int) -> None:
        self._file = file
        self._most = most
        self._size = file.seek(0, 2)
        self.taken = 0

    def read(self, size: int = -1) -> bytes:
        """Read `size` bytes, or all remaining ones."""
        if size < 0:
            size = max(0, self._size - self._file.tell())
        if size > self._most:
            raise ArchiveTooLargeError("its directory is too long for the largest number of members")
        data = self._file.read(size)
        self.taken += len(data)
        return data

    def seek(self, position: int, whence: int = 0) -> int:
        """Go to a position."""
        return self._file.seek(position, whence)

    def tell(self) -> int:
        """The current position."""
        return self._file.tell()

    def seekable(self) -> bool:
        """Whether the file supports seeking: yes."""
        return True


def list_zip(file: ArchiveFile, limits: ArchiveLimits) -> MemberList:
    """List all members by the directory; the library reads no more bytes of a member than it says.

    Raises
    ------
    ArchiveTooLargeError
        The archive exceeds the limit of members or of bytes.
    """
    try:
        _, _, infos = _opened(file, limits)
    except MalformedArchiveError as error:
        return MemberList([], error)
    members: list[ArchiveMember] = []
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
    return MemberList(members, None)


def read_zip(
    file: ArchiveFile, limits: ArchiveLimits, wanted: Container[int]
) -> Iterator[tuple[int, bytes | MemberFault]]:
    """The bytes of the wanted members, each with its place, or the reasons of refusal, in archive order."""
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
    file: ArchiveFile, limits: ArchiveLimits
) -> tuple[zipfile.ZipFile, BoundedFile, list[tuple[int, zipfile.ZipInfo]]]:
    """The archive, the file that it reads, and its members except folders with their places."""
    bounded = BoundedFile(file, max(LEAST_DIRECTORY_BYTES, ENTRY_BYTES * limits.members))
    try:
        archive = zipfile.ZipFile(bounded)
    except ServiceError:
        raise
    # Hostile directories can make the library raise any exception.
    except Exception as error:
        raise MalformedArchiveError(f"the archive's directory cannot be read: {error}") from error
    infos = archive.infolist()
    if len(infos) > limits.members:
        raise ArchiveTooLargeError(f"it has {len(infos)} members, more than {limits.members}")
    return archive, bounded, list(enumerate(info for info in infos if not info.is_dir()))


def _unpacked(
    archive: zipfile.ZipFile, bounded: BoundedFile, info: zipfile.ZipInfo, limits: ArchiveLimits
) -> bytes:
    """Unpack a member and check the limits meanwhile."""
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


def _fault(info: zipfile.ZipInfo, limits: ArchiveLimits) -> MemberFault | None:
    """The fault of a member by the directory."""
    kind = stat.S_IFMT(info.external_attr >> 16)
    if stat.S_ISLNK(kind):
        return MemberKindError("it is a link")
    if kind and not stat.S_ISREG(kind):
        return MemberKindError("it is not a regular file")
    if info.flag_bits & ENCRYPTED:
        return MemberEncryptedError("it is encrypted")
    if info.compress_type not in METHODS:
        return MemberKindError("its compression method is not supported; deflate is, and no compression")
    try:
        limits.check_member(info.file_size)
    except MemberTooLargeError as error:
        return error
    return None
