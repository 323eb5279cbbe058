"""What every archive has alike: its limits, its members, and which of them cannot be taken."""

import re
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Protocol

from core.errors import CoreError
from core.io import ENDINGS, format_of
from service.errors import ServiceError
from service.jobs.errors import MemberNameError, MemberRepeatedError, MemberTooLargeError, NestedArchiveError
from service.shapes.fields import base_name, clean_name

PIECE = 64 * 1024
"""Bytes that are unpacked at a time."""

RATIO_FROM = 1024 * 1024
"""What unpacks to less than this is small, whatever it was packed into."""

PATH_CHARACTERS = 1024

_NESTED = frozenset({"zip", "tar", "gz", "tgz", "bz2", "tbz2", "xz", "txz", "zst", "7z", "rar"}) - set(
    ENDINGS
)
_DRIVE = re.compile(r"[A-Za-z]:")
_UNSHOWN = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]")

Fault = ServiceError | CoreError
"""Why a member is not taken; each has its `kind`."""


class Readable(Protocol):
    """An archive's bytes."""

    def read(self, size: int, /) -> bytes:
        """Up to so many of the next bytes; none at the end."""

    def seek(self, position: int, whence: int = 0, /) -> int:
        """Go to a place."""

    def tell(self) -> int:
        """The place."""


@dataclass(frozen=True)
class ArchiveLimits:
    """What an archive may hold.

    Attributes
    ----------
    members : int
        How many, folders included.
    member_bytes : int
        Of one, unpacked.
    total_bytes : int
        Of all, unpacked.
    ratio : float
        How many times its packed size anything of more than `RATIO_FROM` may unpack to.
    """

    members: int
    member_bytes: int
    total_bytes: int
    ratio: float

    def check_ratio(self, unpacked: int, packed: int) -> None:
        """Raise where bytes unpack to far more than they are.

        Raises
        ------
        MemberTooLargeError
        """
        if unpacked > RATIO_FROM and unpacked > self.ratio * packed:
            raise MemberTooLargeError(f"it unpacks to more than {self.ratio:g} times its packed size")

    def check_member(self, size: int) -> None:
        """Raise where a member has too many bytes, whether it says so or they were counted.

        Raises
        ------
        MemberTooLargeError
        """
        if size > self.member_bytes:
            raise MemberTooLargeError(f"at most {self.member_bytes} bytes of one file are taken")


@dataclass(frozen=True)
class Member:
    """A member that is not a folder.

    Attributes
    ----------
    place : int
        Among all members of the archive.
    path : str
        Its name in the archive, as it can be shown.
    name : str
        What the shape is called: the last part of the path.
    fault : Fault or None
        Why it is not taken, as far as its header tells.
    """

    place: int
    path: str
    name: str
    fault: Fault | None


@dataclass(frozen=True)
class Listing:
    """The members of an archive, and what ended the list before the archive's end."""

    members: list[Member]
    problem: ServiceError | None


def describe(
    place: int, path: str, taken: AbstractSet[str], found: Fault | None
) -> tuple[Member, str | None]:
    """A member as it is listed, and its name as the next ones must not have it.

    Parameters
    ----------
    place : int
    path : str
        As the archive has it.
    taken : set of str
        The names of the members before.
    found : Fault or None
        What is wrong with its kind or size, which comes second to what is wrong with its name.
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
        return Member(place, path_shown, name, error), None
    except (ServiceError, CoreError) as error:
        return Member(place, path_shown, name, error), plain
    return Member(place, path_shown, name, None), plain


def shown(text: str) -> str:
    """Text from a stranger as it can be stored and shown: what is no character is replaced."""
    return _UNSHOWN.sub("\ufffd", text)


def _plain(path: str) -> str:
    """The path without parts that mean nothing.

    Nothing is ever written under such a name; one that leads elsewhere was made to do harm all the same.
    """
    slashed = path.replace("\\", "/")
    container = [part for part in slashed.split("/") if part not in {"", "."}]
    if slashed.startswith("/") or _DRIVE.match(slashed):
        raise MemberNameError("its name is an absolute path")
    if ".." in container:
        raise MemberNameError("its name leads out of the archive")
    if len(path) > PATH_CHARACTERS:
        raise MemberNameError(f"its name has more than {PATH_CHARACTERS} characters")
    return "/".join(container)


def _shape_name(path: str) -> str:
    try:
        return clean_name(base_name(path))
    except ValueError as error:
        raise MemberNameError(f"its name cannot be a shape's: {error}") from error
