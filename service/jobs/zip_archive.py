"""Zip archives: a file in; its members, each with its bytes or the reason of its refusal, out.

Sizes in headers are compared with the limits and not trusted after that: bytes are counted while they are
unpacked. No member is written to disk.
"""

import re
import stat
import zipfile
from collections import Counter
from collections.abc import Container, Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from typing import BinaryIO

from core.errors import CoreError
from core.io import format_of
from service.errors import ServiceError
from service.settings import Settings
from service.shapes.fields import base_name, clean_name

PIECE = 64 * 1024
"""Bytes that are unpacked at a time."""

RATIO_FROM = 1024 * 1024
"""Unpacked size in bytes below which the compression ratio is not limited."""

PATH_CHARACTERS = 1024

ENTRY_BYTES = 512
"""The limit of the directory's size per member, three times the usual size."""

LEAST_DIRECTORY_BYTES = 1024 * 1024

# For other methods the library does not limit the size of the output, nor the memory of lzma.
METHODS = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
ENCRYPTED = 0x1 | 0x40 | 0x2000

_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")
_NESTED = frozenset({"zip", "tar", "gz", "tgz", "bz2", "tbz2", "xz", "txz", "zst", "7z", "rar"})
_DRIVE = re.compile(r"[A-Za-z]:")
_UNSHOWN = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]")

MemberFault = ServiceError | CoreError
"""The reason to refuse a member; its `kind` is that of the problem."""


class UnknownArchiveError(ServiceError, kind="unknown-archive"):
    """The file is not a zip."""


class MalformedArchiveError(ServiceError, kind="malformed-archive"):
    """The directory of the archive cannot be read, or the archive is gone."""


class ArchiveTooLargeError(ServiceError, kind="archive-too-large"):
    """The zip has too many members, or unpacks to too many bytes."""


class MemberError(ServiceError):
    """A member is refused; `kind` is that of the problem."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


@dataclass(frozen=True)
class ArchiveMember:
    """A member that is not a folder.

    `path` is its name in the archive, with unprintable characters replaced; `name` is the last part, the name
    of the shape. `fault` is the reason to refuse the member, as far as its header tells.
    """

    path: str
    name: str
    fault: MemberFault | None


def check_zip(file: BinaryIO) -> None:
    """Raise unless a file begins as a zip does, whatever its name.

    Raises
    ------
    UnknownArchiveError
    """
    file.seek(0)
    if file.read(4) not in _MAGIC:
        raise UnknownArchiveError("the file is not a zip")


class ZipArchive:
    """A zip. Its members except folders have positions from 0.

    Raises
    ------
    ArchiveTooLargeError
        It has more members than the limit.
    MalformedArchiveError
        Its directory cannot be read.
    """

    def __init__(self, file: BinaryIO, limits: Settings) -> None:
        self._limits = limits
        most = limits.max_archive_files
        self._file = _BoundedFile(file, max(LEAST_DIRECTORY_BYTES, ENTRY_BYTES * most))
        try:
            self._zip = zipfile.ZipFile(self._file)
        except ServiceError:
            raise
        # Hostile directories can make the library raise any exception.
        except Exception as error:
            raise MalformedArchiveError(f"the archive's directory cannot be read: {error}") from error
        infos = self._zip.infolist()
        if len(infos) > most:
            raise ArchiveTooLargeError(f"it has {len(infos)} members, more than {most}")
        self._infos = [info for info in infos if not info.is_dir()]
        # The buffers of glTF by their folder, and their bytes together.
        self._buffers: dict[str, list[zipfile.ZipInfo]] = {}
        self._buffer_bytes: Counter[str] = Counter()
        for info in self._infos:
            if info.orig_filename.lower().endswith(".bin"):
                with suppress(MemberError):
                    _check_header(info, limits)
                    folder = _normalised(info.orig_filename).rpartition("/")[0]
                    self._buffers.setdefault(folder, []).append(info)
                    self._buffer_bytes[folder] += info.file_size

    def members(self) -> list[ArchiveMember]:
        """List all members by the directory.

        Raises
        ------
        ArchiveTooLargeError
            The sizes of the members that are taken sum up to more than the limit.
        """
        members: list[ArchiveMember] = []
        paths: set[str] = set()
        total = 0
        for info in self._infos:
            path = info.orig_filename
            shown_path = shown(path)[:PATH_CHARACTERS]
            try:
                normalised = _normalised(path)
                if normalised in paths:
                    raise MemberError("member-repeated", "a member of the archive before it has this name")
                name = _checked_name(path)
                paths.add(normalised)
                _check_header(info, self._limits)
                format_of(base_name(path))
                members.append(ArchiveMember(shown_path, name, None))
                total += info.file_size
                if normalised.lower().endswith(".gltf"):
                    total += self._buffer_bytes[normalised.rpartition("/")[0]]
            except (ServiceError, CoreError) as error:
                members.append(ArchiveMember(shown_path, base_name(shown_path), error))
        most = self._limits.max_unpacked_bytes
        if total > most:
            raise ArchiveTooLargeError(f"it unpacks to {total} bytes, more than {most}")
        return members

    def read(self, wanted: Container[int]) -> Iterator[tuple[int, bytes | MemberFault]]:
        """Yield the positions of the wanted members with their bytes, or the reasons of refusal, in order."""
        for position, info in enumerate(self._infos):
            if position in wanted:
                try:
                    yield position, self._unpacked(info)
                except MemberError as error:
                    yield position, error

    def _unpacked(self, info: zipfile.ZipInfo) -> bytes:
        """Unpack a member; a glTF and the buffers in its folder become a ZIP of them all."""
        beside: list[zipfile.ZipInfo] = []
        if info.orig_filename.lower().endswith(".gltf"):
            beside = self._buffers.get(_normalised(info.orig_filename).rpartition("/")[0], [])
        if not beside:
            return self._unpacked_alone(info)
        bundle = BytesIO()
        with zipfile.ZipFile(bundle, "w") as files:
            for member in (info, *beside):
                # The earliest time that a ZIP can hold: the same members give the same bytes.
                entry = zipfile.ZipInfo(_normalised(member.orig_filename), (1980, 1, 1, 0, 0, 0))
                files.writestr(entry, self._unpacked_alone(member))
                _check_size(self._limits, bundle.tell(), bundle.tell())
        return bundle.getvalue()

    def _unpacked_alone(self, info: zipfile.ZipInfo) -> bytes:
        """Unpack a member and check the limits meanwhile."""
        data = bytearray()
        before = self._file.taken
        try:
            with self._zip.open(info) as opened:
                while piece := opened.read(PIECE):
                    data += piece
                    _check_size(self._limits, len(data), self._file.taken - before)
        except ServiceError:
            raise
        except Exception as error:
            raise MemberError("member-damaged", f"it cannot be unpacked: {error}") from error
        if len(data) != info.file_size:
            raise MemberError("member-damaged", "it has fewer bytes than the directory says")
        return bytes(data)


def shown(text: str) -> str:
    """Replace unprintable characters of a text, so that it can be stored and displayed."""
    return _UNSHOWN.sub("\ufffd", text)


class _BoundedFile:
    """A file that limits the size of one read: the library reads the whole directory at once.

    `taken` counts the bytes that were read.
    """

    def __init__(self, file: BinaryIO, most: int) -> None:
        self._file = file
        self._most = most
        self._size = file.seek(0, 2)
        self.seek, self.tell, self.seekable = file.seek, file.tell, lambda: True
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


def _normalised(path: str) -> str:
    """Return the path without empty parts and `.`; raise MemberError if it leads out of the archive."""
    slashed = path.replace("\\", "/")
    parts = [part for part in slashed.split("/") if part not in {"", "."}]
    if slashed.startswith("/") or _DRIVE.match(slashed):
        raise MemberError("member-name", "its name is an absolute path")
    if ".." in parts:
        raise MemberError("member-name", "its name leads out of the archive")
    if len(path) > PATH_CHARACTERS:
        raise MemberError("member-name", f"its name has more than {PATH_CHARACTERS} characters")
    return "/".join(parts)


def _checked_name(path: str) -> str:
    """Return the file name in a path; raise MemberError if no shape can have it, or it is an archive's."""
    try:
        name = clean_name(base_name(path))
    except ValueError as error:
        raise MemberError("member-name", f"its name cannot be a shape's: {error}") from error
    if name.rpartition(".")[2].lower() in _NESTED:
        raise MemberError("nested-archive", "an archive inside of an archive is not read: send it by itself")
    return name


def _check_header(info: zipfile.ZipInfo, limits: Settings) -> None:
    """Raise if the directory says that a member is no plain file of a size that is taken."""
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind and not stat.S_ISREG(kind):
        raise MemberError("member-kind", "it is a link" if stat.S_ISLNK(kind) else "it is not a regular file")
    if info.flag_bits & ENCRYPTED:
        raise MemberError("member-encrypted", "it is encrypted")
    if info.compress_type not in METHODS:
        raise MemberError(
            "member-kind", "its compression method is not supported; deflate is, and no compression"
        )
    _check_size(limits, info.file_size)


def _check_size(limits: Settings, unpacked: int, packed: int | None = None) -> None:
    """Raise MemberError if a member, by its header or by its unpacked bytes, is too large."""
    if unpacked > limits.max_upload_bytes:
        raise MemberError(
            "member-too-large", f"at most {limits.max_upload_bytes} bytes of one file are taken"
        )
    ratio = limits.max_unpacked_ratio
    if packed is not None and unpacked > RATIO_FROM and unpacked > ratio * packed:
        raise MemberError("member-too-large", f"it unpacks to more than {ratio:g} times its packed size")
