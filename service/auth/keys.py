"""API keys. The service has only their SHA-256, which is safe because a key has 256 random bits."""

import hashlib
import hmac
import re
import secrets
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from service.collection import is_name

Level = Literal["read", "full"]

# The prefix lets scanners for leaked secrets recognise a key.
PREFIX = "isoshape_"

_DIGEST = re.compile(r"[0-9a-f]{64}")


def new_key() -> str:
    """A new random key."""
    return PREFIX + secrets.token_urlsafe(32)


def digest_of(key: str) -> str:
    """The SHA-256 of a key, as 64 hexadecimal digits."""
    return hashlib.sha256(key.encode()).hexdigest()


@dataclass(frozen=True)
class Grant:
    """The access rights of a request.

    Attributes
    ----------
    level : "read" or "full"
    digest : str or None
        SHA-256 of the key; None if the service has no keys.
    signed_in : bool
        Whether the request carried the cookie of a session instead of the key.
    collections : frozenset of str or None
        Names of the allowed collections; None allows all.
    """

    level: Level
    digest: str | None = None
    signed_in: bool = False
    collections: frozenset[str] | None = None


@dataclass(frozen=True)
class KeyEntry:
    """A key in a list of keys: its digest and the names of its allowed collections; None allows all."""

    digest: str
    collections: frozenset[str] | None

    @classmethod
    def read(cls, text: str) -> "KeyEntry":
        """Parse an entry in the form of `write`; the digest may be in upper case.

        Raises
        ------
        ValueError
            The text is not an entry.
        """
        digest, colon, names = text.strip().partition(":")
        listed = names.split("+")
        if not _DIGEST.fullmatch(digest.lower()) or (colon and not all(map(is_name, listed))):
            raise ValueError("a key in a list of keys is digest, or digest:name+name")
        return cls(digest.lower(), frozenset(listed) if colon else None)

    def write(self) -> str:
        """Format the entry as `digest` or `digest:name+name`."""
        return (
            self.digest if self.collections is None else f"{self.digest}:{'+'.join(sorted(self.collections))}"
        )


class KeyRing:
    """The keys of a service. A key in both lists has full access."""

    def __init__(self, full: Collection[str], read: Collection[str]) -> None:
        self._grants: dict[str, Grant] = {}
        lists: tuple[tuple[Level, Collection[str]], ...] = (("read", read), ("full", full))
        for level, entries in lists:
            for entry in map(KeyEntry.read, entries):
                self._grants[entry.digest] = Grant(level, entry.digest, collections=entry.collections)

    def __bool__(self) -> bool:
        return bool(self._grants)

    def grant(self, key: str) -> Grant | None:
        """The grant of a key, or None for an unknown key. The time does not depend on the key."""
        given = digest_of(key)
        found: Grant | None = None
        for digest, grant in self._grants.items():
            if hmac.compare_digest(digest, given):
                found = grant
        return found
