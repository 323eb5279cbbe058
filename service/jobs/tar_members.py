"""Members of tar archives, plain or compressed, in one pass.

`tarfile` parses the headers. `UnpackedStream` limits their length and prevents seeking back. `tarfile` takes
an invalid header for the end of the archive, so that the end is checked separately.
"""

import tarfile
from collections.abc import Container, Iterator

from service.errors import ServiceError
from service.jobs.errors import (
    ArchiveTooLargeError,
    MalformedArchiveError,
    MemberDamagedError,
    MemberKindError,
    MemberTooLargeError,
)
from service.jobs.members import ArchiveFile, ArchiveLimits, ArchiveMember, MemberFault, MemberList, describe
from service.jobs.unpacking import UNPACKERS, UnpackedStream

HEADER_BYTES = 256 * 1024
"""Limit of all headers of one member; the longest encoding of a long name is far shorter."""


def is_header(block: bytes) -> bool:
    """Whether 512 bytes are the first header of a tar archive."""
    try:
        tarfile.TarInfo.frombuf(block[: tarfile.BLOCKSIZE], "utf-8", "surrogateescape")
    except (tarfile.TarError, ValueError):
        return False
    return True


def first_block(file: ArchiveFile, format: str, limits: ArchiveLimits) -> bytes:
    """The first 512 unpacked bytes."""
    stream = UnpackedStream(file, UNPACKERS.get(format), limits)
    stream.allowance = tarfile.BLOCKSIZE
    return stream.read(tarfile.BLOCKSIZE)


def list_tar(file: ArchiveFile, format: str, limits: ArchiveLimits) -> MemberList:
    """List all members, which unpacks the whole archive.

    Raises
    ------
    ArchiveTooLargeError
        The archive exceeds the limit of members or of bytes.
    """
    members: list[ArchiveMember] = []
    taken: set[str] = set()
    try:
        for place, info, _ in _entries(file, format, limits):
            member, plain = describe(place, info.name, taken, _fault(info, limits))
            members.append(member)
            if plain is not None:
                taken.add(plain)
    except MalformedArchiveError as error:
        return MemberList(members, error)
    return MemberList(members, None)


def read_tar(
    file: ArchiveFile, format: str, limits: ArchiveLimits, wanted: Container[int]
) -> Iterator[tuple[int, bytes | MemberFault]]:
    """The bytes of the wanted members, each with its place, or the reasons of refusal, in archive order.

    The iteration ends where the archive is damaged: later members are missing.
    """
    try:
        for place, info, stream in _entries(file, format, limits):
            if place in wanted:
                yield place, _bytes_of(info, stream)
    except MalformedArchiveError:
        return


def _bytes_of(info: tarfile.TarInfo, stream: UnpackedStream) -> bytes | MemberFault:
    stream.allowance = info.size
    try:
        stream.seek(info.offset_data)
        data = stream.read(info.size)
    except MalformedArchiveError as error:
        return MemberDamagedError(str(error))
    return data if len(data) == info.size else MemberDamagedError("the archive ends in the middle of it")


def _entries(
    file: ArchiveFile, format: str, limits: ArchiveLimits
) -> Iterator[tuple[int, tarfile.TarInfo, UnpackedStream]]:
    """Every member except folders, with its place and the stream of its bytes."""
    stream = UnpackedStream(file, UNPACKERS.get(format), limits)
    stream.allowance = HEADER_BYTES
    archive: tarfile.TarFile | None = None
    place = count = end = 0
    while True:
        try:
            if archive is None:
                archive = tarfile.TarFile(fileobj=stream, encoding="utf-8")  # type: ignore[arg-type]
            stream.allowance = HEADER_BYTES
            info = archive.next()
            if info is not None and (info.size < 0 or archive.offset <= end):
                raise MalformedArchiveError("a header in the archive leads back")
        except ServiceError:
            raise
        # Hostile headers can make the library raise any exception.
        except Exception as error:
            raise MalformedArchiveError(f"the archive is damaged: {error}") from error
        if info is None:
            _check_end(stream, archive.offset)
            return
        end = archive.offset
        # The library collects all members, and global headers apply to all later members.
        archive.members.clear()  # type: ignore[attr-defined]
        archive.pax_headers = {}
        count += 1
        if count > limits.members:
            raise ArchiveTooLargeError(f"it has more than {limits.members} members")
        if not info.isdir():
            yield place, info, stream
            place += 1


def _check_end(stream: UnpackedStream, offset: int) -> None:
    """Raise unless the archive ends at the last header that the library has read."""
    stream.allowance = tarfile.BLOCKSIZE
    stream.seek(offset)
    block = stream.read(tarfile.BLOCKSIZE)
    if block.strip(b"\0") or len(block) not in {0, tarfile.BLOCKSIZE}:
        raise MalformedArchiveError("a header in the middle of the archive cannot be read")


def _fault(info: tarfile.TarInfo, limits: ArchiveLimits) -> MemberFault | None:
    """The fault of a member by its header; the library reads no more bytes than the header says."""
    if info.issparse():
        return MemberKindError("sparse files are not supported")
    if info.issym() or info.islnk():
        return MemberKindError("it is a link")
    if not info.isreg():
        return MemberKindError("it is not a regular file")
    try:
        limits.check_member(info.size)
    except MemberTooLargeError as error:
        return error
    return None
