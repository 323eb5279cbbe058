"""Zip archives: a file in; its members, each with its bytes or the reason of its refusal, out.

A confined process reads the directory. Sizes in it are compared with the limits and not trusted after that:
bytes are counted while they are unpacked. No member is written to disk.
"""

import json
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Container, Iterator
from copy import copy
from dataclasses import dataclass
from io import BytesIO
from typing import Annotated, BinaryIO
from urllib.parse import quote

from pydantic import Field, TypeAdapter, ValidationError

from core.errors import CoreError, MeshTooComplexError
from core.io import format_of
from service.errors import ServiceError, TaskTimeLimitError, WorkerCrashedError
from service.settings import Settings
from service.shapes.fields import base_name, clean_name
from service.storage.files import disk_errors

PIECE = 64 * 1024
"""Bytes that are unpacked at a time."""

RATIO_FROM = 1024 * 1024
"""Unpacked size in bytes below which the compression ratio is not limited."""

PATH_CHARACTERS = 1024

ENTRY_BYTES = 512
"""The limit of the directory's size per member, three times the usual size."""

LEAST_DIRECTORY_BYTES = 1024 * 1024

AFTER_DIRECTORY = 128 * 1024
"""More bytes than can follow the directory: three records, and a comment of 64 KiB."""

METHODS = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
ENCRYPTED = 0x1 | 0x40 | 0x2000

_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")
_NESTED = frozenset({"zip", "tar", "gz", "tgz", "bz2", "tbz2", "xz", "txz", "zst", "7z", "rar"})
_DRIVE = re.compile(r"[A-Za-z]:")
_UNSHOWN = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]")
# A local header ends with the lengths of the name and of the extra fields, which follow it.
_LOCAL_HEADER = struct.Struct("<4s22xHH")

_Count = Annotated[int, Field(ge=0, lt=2**63)]
_DIRECTORY = TypeAdapter(
    tuple[_Count, list[tuple[str, _Count, _Count, _Count, _Count, _Count, _Count, _Count]]]
)

ReadDirectory = Callable[[bytes, int, int], bytes]
"""Reads the directory of a ZIP: `service.compute.sandbox.zip_directory`."""

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
    of the shape. `size` is in bytes, as its header tells, and so far `fault`, the reason to refuse the
    member.
    """

    path: str
    name: str
    size: int
    fault: MemberFault | None


def check_zip(file: BinaryIO) -> None:
    """Raise UnknownArchiveError unless a file begins as a zip does, whatever its name."""
    file.seek(0)
    if file.read(4) not in _MAGIC:
        raise UnknownArchiveError("the file is not a zip")


@dataclass(frozen=True, slots=True)
class _Entry:
    """An entry of the directory; sizes in bytes, `offset` of its local header."""

    path: str
    flags: int
    method: int
    external_attributes: int
    offset: int
    packed_size: int
    size: int
    checksum: int


class ZipArchive:
    """A zip in an open file, within the limits of settings. Its members except folders have positions from 0.

    `read_directory` reads the directory, in a confined process. Raise ArchiveTooLargeError if the zip has
    more members than the limit, and MalformedArchiveError if its directory cannot be read.
    """

    def __init__(self, file: BinaryIO, limits: Settings, read_directory: ReadDirectory) -> None:
        self._file, self._limits = file, limits
        self._size = file.seek(0, 2)
        self._unpacked_bytes = 0
        entries = self._directory(read_directory)
        # The buffers of glTF, by their folder.
        folders = {_folder_of(entry) for entry in entries if entry.path.lower().endswith(".gltf")} - {None}
        self._buffers: dict[str | None, list[_Entry]] = {}
        self._entries: list[_Entry] = []
        for entry in entries:
            folder = _folder_of(entry)
            if entry.path.lower().endswith(".bin") and folder in folders and _is_sound(entry, limits):
                self._buffers.setdefault(folder, []).append(entry)
            else:
                self._entries.append(entry)

    def _directory(self, read_directory: ReadDirectory) -> list[_Entry]:
        most = self._limits.max_archive_files
        size = self._size
        longest = max(LEAST_DIRECTORY_BYTES, ENTRY_BYTES * most) + AFTER_DIRECTORY
        self._file.seek(max(0, size - longest))
        try:
            count, entries = _DIRECTORY.validate_json(read_directory(self._read(longest), size, most))
        except MeshTooComplexError as error:
            raise ArchiveTooLargeError(str(error)) from error
        except ValidationError as error:
            raise MalformedArchiveError("the archive's directory cannot be read") from error
        except (ValueError, MemoryError, TaskTimeLimitError, WorkerCrashedError) as error:
            raise MalformedArchiveError(f"the archive's directory cannot be read: {error}") from error
        if count > most:
            raise ArchiveTooLargeError(f"it has {count} members, more than {most}")
        members = [_Entry(*entry) for entry in entries]
        # Bytes that many members share would be unpacked for each (CVE-2024-0450).
        if sum(member.packed_size for member in members) > self._size:
            raise MalformedArchiveError("members of the archive overlap")
        return members

    def _read(self, size: int) -> bytes:
        """Read the next bytes; a disk that fails is no fault of the archive."""
        with disk_errors("the archive cannot be read"):
            return self._file.read(size)

    def members(self) -> list[ArchiveMember]:
        """List all members by the directory.

        Raise ArchiveTooLargeError if the sizes of the members that are taken sum up to more than the limit.
        """
        members: list[ArchiveMember] = []
        paths: set[str] = set()
        total = 0
        for entry in self._entries:
            path = entry.path
            shown_path = shown(path)[:PATH_CHARACTERS]
            try:
                normalised = _normalised(path)
                if normalised in paths:
                    raise MemberError("member-repeated", "a member of the archive before it has this name")
                name = _checked_name(path)
                paths.add(normalised)
                _check_entry(entry, self._limits)
                # As macOS adds one to each file, with the same ending.
                if any(part.startswith(".") for part in normalised.split("/")):
                    raise MemberError("unknown-format", "it is hidden, so that it is no mesh")
                format_of(base_name(path))
                members.append(ArchiveMember(shown_path, name, entry.size, None))
                total += entry.size
            except (ServiceError, CoreError) as error:
                members.append(ArchiveMember(shown_path, base_name(shown_path), entry.size, error))
        most = self._limits.max_unpacked_bytes
        if total > most:
            raise ArchiveTooLargeError(f"it unpacks to {total} bytes, more than {most}")
        return members

    def on(self, file: BinaryIO) -> "ZipArchive":
        """Return the same zip on another open file of the same bytes, without reading its directory again."""
        other = copy(self)
        other._file, other._unpacked_bytes = file, 0
        return other

    def read(self, wanted: Container[int]) -> Iterator[tuple[int, bytes | MemberFault]]:
        """Yield the positions of the wanted members with their bytes, or the reasons of refusal, in order."""
        for position, entry in enumerate(self._entries):
            if position in wanted:
                try:
                    yield position, self._unpacked(entry)
                except MemberError as error:
                    yield position, error

    def _unpacked(self, entry: _Entry) -> bytes:
        """Unpack a member; a glTF and the buffers in its folder that it names become a ZIP of them all."""
        data = self._unpacked_alone(entry)
        beside: list[_Entry] = []
        if entry.path.lower().endswith(".gltf"):
            beside = [buffer for buffer in self._buffers.get(_folder_of(entry), []) if _names(data, buffer)]
        if not beside:
            return data
        bundle = BytesIO()
        with zipfile.ZipFile(bundle, "w") as files:
            for member in (entry, *beside):
                # The earliest time that a ZIP can hold: the same members give the same bytes.
                info = zipfile.ZipInfo(_normalised(member.path), (1980, 1, 1, 0, 0, 0))
                files.writestr(info, data if member is entry else self._unpacked_alone(member))
                _check_size(self._limits, bundle.tell(), bundle.tell())
        return bundle.getvalue()

    def _unpacked_alone(self, entry: _Entry) -> bytes:
        """Unpack a member and check the limits meanwhile."""
        data = bytearray()
        for piece, packed in self._pieces(entry):
            data += piece
            _check_size(self._limits, len(data), packed)
            self._unpacked_bytes += len(piece)
            if self._unpacked_bytes > self._limits.max_unpacked_bytes:
                raise MemberError(
                    "member-too-large",
                    f"the archive unpacks to more than {self._limits.max_unpacked_bytes} bytes",
                )
        if len(data) != entry.size or zlib.crc32(data) != entry.checksum:
            raise MemberError("member-damaged", "its bytes are not those that the directory describes")
        return bytes(data)

    def _pieces(self, entry: _Entry) -> Iterator[tuple[bytes, int]]:
        """Yield pieces of a member, of at most `PIECE` bytes, and the packed bytes read so far."""
        # A file system may refuse a position far beyond the end.
        self._file.seek(min(entry.offset, self._size))
        header = self._read(_LOCAL_HEADER.size)
        if len(header) < _LOCAL_HEADER.size or not header.startswith(_MAGIC[0]):
            raise MemberError("member-damaged", "it is not where the directory says")
        _, name_length, extra_length = _LOCAL_HEADER.unpack(header)
        self._file.seek(name_length + extra_length, 1)
        inflater = zlib.decompressobj(-zlib.MAX_WBITS)
        packed = 0
        while packed < entry.packed_size:
            data = self._read(min(PIECE, entry.packed_size - packed))
            if not data:
                raise MemberError("member-damaged", "the archive ends within it")
            packed += len(data)
            if entry.method == zipfile.ZIP_STORED:
                yield data, packed
                continue
            while data:
                try:
                    piece = inflater.decompress(data, PIECE)
                except zlib.error as error:
                    raise MemberError("member-damaged", f"it cannot be unpacked: {error}") from error
                yield piece, packed
                data = inflater.unconsumed_tail
            # Else the library collects all that follows.
            if inflater.eof and packed < entry.packed_size:
                raise MemberError("member-damaged", "its packed bytes end before the directory says")
        if entry.method != zipfile.ZIP_STORED:
            yield inflater.flush(), packed


def _folder_of(entry: _Entry) -> str | None:
    """Return the folder of a member; None if its path leads out of the archive."""
    try:
        return _normalised(entry.path).rpartition("/")[0]
    except MemberError:
        return None


def _is_sound(entry: _Entry, limits: Settings) -> bool:
    try:
        _check_entry(entry, limits)
    except MemberError:
        return False
    return True


def _names(gltf: bytes, buffer: _Entry) -> bool:
    """Return whether a glTF names a buffer: as it is, with percent signs, or as JSON escapes it."""
    name = base_name(buffer.path)
    return any(text.encode() in gltf for text in (name, quote(name), json.dumps(name)[1:-1]))


def shown(text: str) -> str:
    """Replace unprintable characters of a text, so that it can be stored and displayed."""
    return _UNSHOWN.sub("\ufffd", text)


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


def _check_entry(entry: _Entry, limits: Settings) -> None:
    """Raise if the directory says that a member is no plain file of a size that is taken."""
    kind = stat.S_IFMT(entry.external_attributes >> 16)
    if kind and not stat.S_ISREG(kind):
        raise MemberError("member-kind", "it is a link" if stat.S_ISLNK(kind) else "it is not a regular file")
    if entry.flags & ENCRYPTED:
        raise MemberError("member-encrypted", "it is encrypted")
    if entry.method not in METHODS:
        raise MemberError(
            "member-kind", "its compression method is not supported; deflate is, and no compression"
        )
    _check_size(limits, entry.size)


def _check_size(limits: Settings, unpacked: int, packed: int | None = None) -> None:
    """Raise MemberError if a member, by its header or by its unpacked bytes, is too large."""
    if unpacked > limits.max_upload_bytes:
        raise MemberError(
            "member-too-large", f"at most {limits.max_upload_bytes} bytes of one file are taken"
        )
    ratio = limits.max_unpacked_ratio
    if packed is not None and unpacked > RATIO_FROM and unpacked > ratio * packed:
        raise MemberError("member-too-large", f"it unpacks to more than {ratio:g} times its packed size")
