"""API keys and the sessions of browsers."""

import hashlib
import hmac
import re
import secrets
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Literal

from service.collection import is_name
from service.errors import MisdirectedRequestError

Level = Literal["read", "full"]

# The prefix lets scanners for leaked secrets recognise a key.
PREFIX = "isoshape_"

_DIGEST = re.compile(r"[0-9a-f]{64}")


def new_key() -> str:
    """Return a new random key."""
    return PREFIX + secrets.token_urlsafe(32)


def digest_of(key: str) -> str:
    """Return the SHA-256 of a key, as 64 hexadecimal digits."""
    return hashlib.sha256(key.encode()).hexdigest()


@dataclass(frozen=True)
class Grant:
    """The access rights of a request.

    `digest` is the SHA-256 of the key, and None if the service has no keys. `signed_in` tells whether the
    request has the cookie of a session in place of the key. `collections` names the allowed collections; None
    allows all.
    """

    level: Level
    digest: str | None = None
    signed_in: bool = False
    collections: frozenset[str] | None = None

    @property
    def shows_paths(self) -> bool:
        """Whether the paths of files of the machine are shown: reading keys must not see them."""
        return self.level == "full"


@dataclass(frozen=True)
class KeyEntry:
    """A key in a list of keys: its digest and the names of its allowed collections; None allows all."""

    digest: str
    collections: frozenset[str] | None

    @classmethod
    def read(cls, text: str) -> "KeyEntry":
        """Parse an entry in the form of `write`; the digest may be in upper case.

        Raise ValueError if the text is not an entry.
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
        """Return the grant of a key, or None for an unknown key. The time does not depend on the key."""
        digest_sent = digest_of(key)
        granted: Grant | None = None
        for digest, grant in self._grants.items():
            if hmac.compare_digest(digest, digest_sent):
                granted = grant
        return granted


COOKIE = "isoshape_session"
SECONDS = 12 * 60 * 60
MOST_EACH = 1000
"""Sessions of one key."""


class Sessions:
    """The grants of signed-in browsers, in memory: a restart signs all of them out.

    A cookie contains random bytes instead of the key; the service stores only the digest of these bytes. A
    session is valid under the name of the service under which it began.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._open: dict[str, tuple[float, Grant, str]] = {}

    def begin(self, grant: Grant, host: str) -> str:
        """Begin a session under a name of the service, and return its token.

        The oldest session of the same key ends if the key has too many; those of other keys go on.
        """
        now = self._clock()
        self._open = {name: session for name, session in self._open.items() if session[0] > now}
        same_key = [name for name, session in self._open.items() if session[1].digest == grant.digest]
        for name in same_key[: max(0, len(same_key) + 1 - MOST_EACH)]:
            del self._open[name]
        token = secrets.token_urlsafe(32)
        self._open[digest_of(token)] = (now + SECONDS, replace(grant, signed_in=True), host)
        return token

    def grant(self, token: str, host: str) -> Grant | None:
        """Return the grant of a session, or None if it has ended or never began.

        Raise MisdirectedRequestError if the session began under another name.
        """
        until, grant, name = self._open.get(digest_of(token), (0.0, None, ""))
        if grant is None or self._clock() >= until:
            return None
        if name != host:
            raise MisdirectedRequestError("the session was opened under another name of the service")
        return grant

    def end(self, token: str) -> None:
        """End the session, if it exists."""
        self._open.pop(digest_of(token), None)
