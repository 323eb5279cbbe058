"""Browsers that have signed in: images and event streams of a page cannot send headers, but cookies."""

import secrets
import time
from collections.abc import Callable
from dataclasses import replace

from service.auth.keys import Grant, digest_of

COOKIE = "isoshape_session"
SECONDS = 12 * 60 * 60
MOST = 1000


class Sessions:
    """What each signed-in browser may do, in memory: a restart signs all of them out.

    A cookie holds random bytes and never the key, and here only its digest is kept.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._open: dict[str, tuple[float, Grant]] = {}

    def begin(self, grant: Grant) -> str:
        """A new session's token. The oldest session ends if there are too many."""
        now = self._clock()
        self._open = {name: held for name, held in self._open.items() if held[0] > now}
        while len(self._open) >= MOST:
            del self._open[next(iter(self._open))]
        token = secrets.token_urlsafe(32)
        self._open[digest_of(token)] = (now + SECONDS, replace(grant, signed_in=True))
        return token

    def grant(self, token: str) -> Grant | None:
        """What the session's browser may do; None when it has ended, or never began."""
        until, grant = self._open.get(digest_of(token), (0.0, None))
        return grant if self._clock() < until else None

    def end(self, token: str) -> None:
        """End the session, if there is one."""
        self._open.pop(digest_of(token), None)
