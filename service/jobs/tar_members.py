"""The members of a tar file, packed or not: in one pass from its beginning.

`tarfile` reads the headers; `Unpacked` sees to it that none is longer than honest ones, and none leads back.
A header that `tarfile` cannot read it takes for the archive's end, so the end is looked at again.
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
from service.jobs.members import ArchiveLimits, Fault, Listing, Member, Readable, describe
from service.jobs.unpacking import UNPACKERS, Unpacked

HEADER_BYTES = 256 * 1024
"""All headers of one member: its name in the longest way that tar programs write it is far shorter."""


def is_header(block: bytes) -> bool:
    """Whether a tar file may begin with these bytes, of which 512 are needed."""
    try:
        tarfile.TarInfo.frombuf(block[: tarfile.BLOCKSIZE], "utf-8", "surrogateescape")
    except (tarfile.TarError, ValueError):
        return False
    return True


def first_block(file: Readable, format: str, limits: ArchiveLimits) -> bytes:
    """The first bytes that would be a header."""
    stream = Unpacked(file, UNPACKERS.get(format), limits)
    stream.allowance = tarfile.BLOCKSIZE
    return stream.read(tarfile.BLOCKSIZE)


def list_tar(file: Readable, format: str, limits: ArchiveLimits) -> Listing:
    """All members, unpacking all of the archive.

    Raises
    ------
    ArchiveTooLargeError
    """
    members: list[Member] = []
    taken: set[str] = set()
    try:
        for place, info, _ in _entries(file, format, limits):
            member, plain = describe(place, info.name, taken, _fault(info, limits))
            members.append(member)
            if plain is not None:
                taken.add(plain)
    except MalformedArchiveError as error:
        return Listing(members, error)
    return Listing(members, None)


def read_tar(
    file: Readable, format: str, limits: ArchiveLimits, wanted: Container[int]
) -> Iterator[tuple[int, bytes | Fault]]:
    """The bytes of the wanted members in their order, or why there are none.

    Where the archive ends in the middle, so does this: what was wanted beyond is left out.
    """
    try:
        for place, info, stream in _entries(file, format, limits):
            if place in wanted:
                yield place, _bytes_of(info, stream)
    except MalformedArchiveError:
        return


def _bytes_of(info: tarfile.TarInfo, stream: Unpacked) -> bytes | Fault:
    stream.allowance = info.size
    try:
        stream.seek(info.offset_data)
        data = stream.read(info.size)
    except MalformedArchiveError as error:
        return MemberDamagedError(str(error))
    return data if len(data) == info.size else MemberDamagedError("the archive ends in the middle of it")


def _entries(
    file: Readable, format: str, limits: ArchiveLimits
) -> Iterator[tuple[int, tarfile.TarInfo, Unpacked]]:
    """Every member but folders, with its place, and the stream that its bytes are in."""
    stream = Unpacked(file, UNPACKERS.get(format), limits)
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
        # What strangers write into headers brings the library to raise anything.
        except Exception as error:
            raise MalformedArchiveError(f"the archive cannot be read on: {error}") from error
        if info is None:
            _check_end(stream, archive.offset)
            return
        end = archive.offset
        # It keeps all of them, and what any of them said of all.
        archive.members.clear()  # type: ignore[attr-defined]
        archive.pax_headers = {}
        count += 1
        if count > limits.members:
            raise ArchiveTooLargeError(f"it has more than {limits.members} members")
        if not info.isdir():
            yield place, info, stream
            place += 1


def _check_end(stream: Unpacked, offset: int) -> None:
    """Raise unless the archive ends where the library saw no further header."""
    stream.allowance = tarfile.BLOCKSIZE
    stream.seek(offset)
    block = stream.read(tarfile.BLOCKSIZE)
    if block.strip(b"\0") or len(block) not in {0, tarfile.BLOCKSIZE}:
        raise MalformedArchiveError("a header in the middle of the archive cannot be read")


def _fault(info: tarfile.TarInfo, limits: ArchiveLimits) -> Fault | None:
    """What is wrong with a member by its header, which for its size is also what can be read of it."""
    if info.issparse():
        return MemberKindError("a file with holes is not taken")
    if info.issym() or info.islnk():
        return MemberKindError("it is a link")
    if not info.isreg():
        return MemberKindError("it is no plain file")
    try:
        limits.check_member(info.size)
    except MemberTooLargeError as error:
        return error
    return None
