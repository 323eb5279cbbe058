"""The archive formats that are read: zip and tar, the latter also compressed by gzip, bzip2 or xz."""

from collections.abc import Container, Iterator

from service.jobs.errors import MalformedArchiveError, UnknownArchiveError
from service.jobs.members import ArchiveFile, ArchiveLimits, MemberFault, MemberList
from service.jobs.tar_members import first_block, is_header, list_tar, read_tar
from service.jobs.zip_members import list_zip, read_zip

ZIP = "zip"
ARCHIVES = (ZIP, "tar", "tar.gz", "tar.bz2", "tar.xz")

_MAGIC = {
    b"PK\x03\x04": ZIP,
    b"PK\x05\x06": ZIP,
    b"\x1f\x8b": "tar.gz",
    b"BZh": "tar.bz2",
    b"\xfd7zXZ\x00": "tar.xz",
}


def archive_format(file: ArchiveFile, limits: ArchiveLimits) -> str:
    """Detect the archive format of a file from its first bytes, regardless of its name.

    Raises
    ------
    UnknownArchiveError
        The format is none of `ARCHIVES`.
    """
    file.seek(0)
    beginning = file.read(max(map(len, _MAGIC)))
    format = next((name for magic, name in _MAGIC.items() if beginning.startswith(magic)), "tar")
    if format == ZIP:
        return format
    file.seek(0)
    try:
        known = is_header(first_block(file, format, limits))
    except MalformedArchiveError:
        known = False
    if not known:
        raise UnknownArchiveError(f"the file is none of these archives: {', '.join(ARCHIVES)}")
    return format


def list_members(file: ArchiveFile, format: str, limits: ArchiveLimits) -> MemberList:
    """The members of an archive.

    Raises
    ------
    ArchiveTooLargeError
        The archive exceeds the limit of members or of bytes.
    """
    file.seek(0)
    return list_zip(file, limits) if format == ZIP else list_tar(file, format, limits)


def read_members(
    file: ArchiveFile, format: str, limits: ArchiveLimits, wanted: Container[int]
) -> Iterator[tuple[int, bytes | MemberFault]]:
    """The bytes of the wanted members, each with its place, or the reasons of refusal, in archive order.

    The iteration ends where the archive is damaged: later members are missing.

    Raises
    ------
    ArchiveTooLargeError
        The archive exceeds the limit of members or of bytes.
    """
    file.seek(0)
    return read_zip(file, limits, wanted) if format == ZIP else read_tar(file, format, limits, wanted)
