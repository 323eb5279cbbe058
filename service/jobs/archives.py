"""The archives that are read: zip, and tar as it is or packed by gzip, bzip2 or xz."""

from collections.abc import Container, Iterator

from service.jobs.errors import MalformedArchiveError, UnknownArchiveError
from service.jobs.members import ArchiveLimits, Fault, Listing, Readable
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


def archive_format(file: Readable, limits: ArchiveLimits) -> str:
    """Which of `ARCHIVES` a file is, by its first bytes; its name does not matter.

    Raises
    ------
    UnknownArchiveError
        It is none of them.
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


def list_members(file: Readable, format: str, limits: ArchiveLimits) -> Listing:
    """The members of an archive.

    Raises
    ------
    ArchiveTooLargeError
        There are more, or more bytes, than the limits allow.
    """
    file.seek(0)
    return list_zip(file, limits) if format == ZIP else list_tar(file, format, limits)


def read_members(
    file: Readable, format: str, limits: ArchiveLimits, wanted: Container[int]
) -> Iterator[tuple[int, bytes | Fault]]:
    """The bytes of the wanted members by their places, or why there are none, in their order.

    Where an archive cannot be read on, this ends: what was wanted beyond is left out.

    Raises
    ------
    ArchiveTooLargeError
    """
    file.seek(0)
    return read_zip(file, limits, wanted) if format == ZIP else read_tar(file, format, limits, wanted)
