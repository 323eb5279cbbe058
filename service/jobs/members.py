"""Members of archives of any format: their limits, and the reasons to refuse them."""

import re
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Protocol

from core.errors import CoreError
from core.io import format_of
from service.errors import ServiceError
from service.jobs.errors import MemberNameError, MemberRepeatedError, MemberTooLargeError, NestedArchiveError
from service.shapes.fields import base_name, clean_name

PIECE = 64 * 1024
"""Bytes that are unpacked at a time."""

RATIO_FROM = 1024 * 1024
"""Unpacked size in bytes below which the compression ratio is not limited."""

PATH_CHARACTERS = 1024

_NESTED = frozenset({"zip", "tar", "gz", "tgz", "bz2", "tbz2", "xz", "txz", "zst", "7z", "rar"})
_DRIVE = re.compile(r"[A-Za-z]:")
_UNSHOWN = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]")

MemberFault = ServiceError | CoreError
"""The reason to refuse a member; its `kind` is that of the problem."""


class ArchiveFile(Protocol):
    """A seekable archive file."""

    def read(self, size: int, /) -> bytes:
        """Read at most `size` bytes; none at the end."""

    def seek(self, position: int, whence: int = 0, /) -> int:
        """Go to a position and return it."""

    def tell(self) -> int:
        """The current position."""


@dataclass(frozen=True)
class ArchiveLimits:
    """The limits of an archive.

    Attributes
    ----------
    members : int
        Number of members, folders included.
    member_bytes : int
        Unpacked size of one member.
    total_bytes : int
        Unpacked size of all members.
    ratio : float
        Unpacked size divided by packed size; applies above `RATIO_FROM` bytes.
    """

    members: int
    member_bytes: int
    total_bytes: int
    ratio: float

    def check_ratio(self, unpacked: int, packed: int) -> None:
        """Raise if the compression ratio exceeds the limit.

        Raises
        ------
        MemberTooLargeError
            The ratio is too large.
        """
        if unpacked > RATIO_FROM and unpacked > self.ratio * packed:
            raise MemberTooLargeError(f"it unpacks to more than {self.ratio:g} times its packed size")

    def check_member(self, size: int) -> None:
        """Raise if a member, by its header or by its unpacked bytes, is too large.

        Raises
        ------
        MemberTooLargeError
            The member has more than `member_bytes` bytes.
        """
        if size > self.member_bytes:
            raise MemberTooLargeError(f"at most {self.member_bytes} bytes of one file are taken")


@dataclass(frozen=True)
class ArchiveMember:
    """A member that is not a folder.

    Attributes
    ----------
    place : int
        Index of the member in the archive.
    path : str
        Name in the archive, with unprintable characters replaced.
    name : str
        Name of the shape: the last part of the path.
    fault : MemberFault or None
        The reason to refuse the member, as far as its header tells.
    """

    place: int
    path: str
    name: str
    fault: MemberFault | None


@dataclass(frozen=True)
class MemberList:
    """The members of an archive, and the error that ended the list early, if any."""

    members: list[ArchiveMember]
    problem: ServiceError | None


def describe(
    place: int, path: str, taken: AbstractSet[str], found: MemberFault | None
) -> tuple[ArchiveMember, str | None]:
    """A member as it is listed, and its normalised name, which later members must not have.

    Parameters
    ----------
    place : int
    path : str
        The name in the archive.
    taken : set of str
        Normalised names of the earlier members.
    found : MemberFault or None
        The fault of the member's kind or size; a fault of its name takes precedence.
    """
    path_shown = shown(path)[:PATH_CHARACTERS]
    name = base_name(path_shown)
    try:
        plain = _plain(path)
        if plain in taken:
            raise MemberRepeatedError("an earlier member of the archive has this name")
        name = _shape_name(path)
        if found is not None:
            raise found
        ending = name.rpartition(".")[2].lower()
        if ending in _NESTED:
            raise NestedArchiveError("an archive inside of an archive is not read: send it by itself")
        format_of(name)
    except MemberNameError as error:
        return ArchiveMember(place, path_shown, name, error), None
    except (ServiceError, CoreError) as error:
        return ArchiveMember(place, path_shown, name, error), plain
    return ArchiveMember(place, path_shown, name, None), plain


def shown(text: str) -> str:
    """Replace unprintable characters of a text, so that it can be stored and displayed."""
    return _UNSHOWN.sub("\ufffd", text)


def _plain(path: str) -> str:
    """The normalised path, without empty parts and `.`.

    No file is ever written to the path; a path that leads out of the archive is refused as hostile.
    """
    slashed = path.replace("\\", "/")
    parts = [part for part in slashed.split("/") if part not in {"", "."}]
    if slashed.startswith("/") or _DRIVE.match(slashed):
        raise MemberNameError("its name is an absolute path")
    if ".." in parts:
        raise MemberNameError("its name leads out of the archive")
    if len(path) > PATH_CHARACTERS:
        raise MemberNameError(f"its name has more than {PATH_CHARACTERS} characters")
    return "/".join(parts)


def _shape_name(path: str) -> str:
    try:
        return clean_name(base_name(path))
    except ValueError as error:
        raise MemberNameError(f"its name cannot be a shape's: {error}") from error
