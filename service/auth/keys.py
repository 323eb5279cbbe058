"""API keys. The service holds their SHA-256 only: a key is 256 random bits, so no guess comes near it."""

import hashlib
import hmac
import re
import secrets
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from service.collection import is_name

Level = Literal["read", "full"]

# So that programs which look for secrets in files know one when they see it.
PREFIX = "isoshape_"

_DIGEST = re.compile(r"[0-9a-f]{64}")


def new_key() -> str:
    """A key that nobody has."""
    return PREFIX + secrets.token_urlsafe(32)


def digest_of(key: str) -> str:
    """The SHA-256 of a key, as 64 hexadecimal digits."""
    return hashlib.sha256(key.encode()).hexdigest()


@dataclass(frozen=True)
class Grant:
    """What a request may do.

    Attributes
    ----------
    level : "read" or "full"
    digest : str or None
        Of the key that says so; None on a service without keys.
    signed_in : bool
        Whether the key was not sent itself, but a cookie of a session that was begun with it.
    collections : frozenset of str or None
        Those that it may be done in; None is all.
    """

    level: Level
    digest: str | None = None
    signed_in: bool = False
    collections: frozenset[str] | None = None


@dataclass(frozen=True)
class Entry:
    """A key in a list of keys: its digest, and the collections it is limited to; None is no limit."""

    digest: str
    collections: frozenset[str] | None

    @classmethod
    def read(cls, text: str) -> "Entry":
        """What `write` wrote; the digest in either case.

        Raises
        ------
        ValueError
            It is no entry.
        """
        digest, colon, names = text.strip().partition(":")
        listed = names.split("+")
        if not _DIGEST.fullmatch(digest.lower()) or (colon and not all(map(is_name, listed))):
            raise ValueError("a key in a list of keys is digest, or digest:name+name")
        return cls(digest.lower(), frozenset(listed) if colon else None)

    def write(self) -> str:
        """As `digest`, or `digest:name+name`."""
        return (
            self.digest if self.collections is None else f"{self.digest}:{'+'.join(sorted(self.collections))}"
        )


class KeyRing:
    """The keys of a service, by their entries. Of a key in both lists, that of the full ones counts."""

    def __init__(self, full: Collection[str], read: Collection[str]) -> None:
        self._grants: dict[str, Grant] = {}
        lists: tuple[tuple[Level, Collection[str]], ...] = (("read", read), ("full", full))
        for level, entries in lists:
            for entry in map(Entry.read, entries):
                self._grants[entry.digest] = Grant(level, entry.digest, collections=entry.collections)

    def __bool__(self) -> bool:
        return bool(self._grants)

    def grant(self, key: str) -> Grant | None:
        """What a key may do, or None for one that is not ours; takes as long for either."""
        given = digest_of(key)
        found: Grant | None = None
        for digest, grant in self._grants.items():
            if hmac.compare_digest(digest, given):
                found = grant
        return found
