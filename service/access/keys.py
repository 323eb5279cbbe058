"""API keys. The service holds their SHA-256 only: a key is 256 random bits, so no guess comes near it."""

import hashlib
import hmac
import secrets
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

Level = Literal["read", "full"]

# So that programs which look for secrets in files know one when they see it.
PREFIX = "isoshape_"


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
    """

    level: Level
    digest: str | None = None
    signed_in: bool = False


class KeyRing:
    """The keys of a service, by their digests. A key that is in both lists may do everything."""

    def __init__(self, full: Collection[str], read: Collection[str]) -> None:
        self._levels: dict[str, Level] = {**dict.fromkeys(read, "read"), **dict.fromkeys(full, "full")}

    def __bool__(self) -> bool:
        return bool(self._levels)

    def grant(self, key: str) -> Grant | None:
        """What a key may do, or None for one that is not ours; takes as long for either."""
        given = digest_of(key)
        found: Grant | None = None
        for digest, level in self._levels.items():
            if hmac.compare_digest(digest, given):
                found = Grant(level, digest)
        return found
