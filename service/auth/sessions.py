"""Sessions of browsers. Images and event streams of a page can send cookies, but no key in a header."""

import secrets
import time
from collections.abc import Callable
from dataclasses import replace

from service.auth.keys import Grant, digest_of
from service.errors import MisdirectedRequestError

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
        own = [name for name, session in self._open.items() if session[1].digest == grant.digest]
        for name in own[: max(0, len(own) + 1 - MOST_EACH)]:
            del self._open[name]
        token = secrets.token_urlsafe(32)
        self._open[digest_of(token)] = (now + SECONDS, replace(grant, signed_in=True), host)
        return token

    def grant(self, token: str, host: str) -> Grant | None:
        """The grant of a session, or None if it has ended or never began.

        Raises
        ------
        MisdirectedRequestError
            The session began under another name.
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
