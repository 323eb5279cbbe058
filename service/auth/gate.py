"""The access decision for each request: key or session, access level, collections and rate limit."""

from starlette.datastructures import Headers
from starlette.requests import cookie_parser

from service.auth.hosts import Hosts, name_in
from service.auth.keys import Grant, KeyRing
from service.auth.rate_limits import RateLimit
from service.auth.rules import PROBES, SAFE_METHODS, from_another_site, needed, of_all_collections
from service.auth.sessions import COOKIE, Sessions
from service.errors import CrossSiteError, ForbiddenError, RateLimitError, UnauthorizedError


class Gate:
    """Keys, sessions, rate limits and names of one service.

    Use it in the event loop only: it has no locks.
    """

    def __init__(self, keys: KeyRing, rate_limit: int, hosts: Hosts) -> None:
        self._keys = keys
        self._hosts = hosts
        self._rates = RateLimit(rate_limit)
        self.sessions = Sessions()

    def grant(self, headers: Headers) -> Grant | None:
        """The grant of a request, from its headers; None if it has neither a key nor an open session.

        Raises
        ------
        UnauthorizedError
            The key is unknown.
        MisdirectedRequestError
            The session was opened under another name of the service.
        """
        if not self._keys:
            return Grant("full")
        key = key_in(headers)
        if key is None:
            token = token_in(headers)
            return None if token is None else self.sessions.grant(token, name_in(headers.get("host", "")))
        grant = self._keys.grant(key)
        if grant is None:
            raise UnauthorizedError("the service does not know this key", wrong=True)
        return grant

    def admit(self, method: str, path: str, headers: Headers) -> Grant | None:
        """The grant of an admitted request; None if its path is public.

        Raises
        ------
        MisdirectedRequestError
            The request names another host.
        CrossSiteError
            A page of another site caused a browser to send the request.
        UnauthorizedError, ForbiddenError
            The request has no key, or its key does not allow the request.
        RateLimitError
            The key has exceeded its rate limit.
        """
        if not (self._keys and path in PROBES):
            self._hosts.check(headers)
        if method not in SAFE_METHODS and key_in(headers) is None and from_another_site(headers):
            raise CrossSiteError("pages of other sites cannot use this service")
        level = needed(method, path)
        if level is None:
            return None
        grant = self.grant(headers)
        if grant is None:
            raise UnauthorizedError("send a key as Authorization: Bearer, or as X-API-Key")
        if level == "full" and grant.level != "full":
            raise ForbiddenError("the key may read and query, and change nothing")
        if grant.collections is not None and of_all_collections(method, path):
            raise ForbiddenError("the key is limited to some collections")
        if grant.digest is not None:
            seconds = self._rates.wait(grant.digest)
            if seconds is not None:
                raise RateLimitError("the key has made too many requests", retry_after=seconds)
        return grant


def key_in(headers: Headers) -> str | None:
    """The key in the header Authorization (scheme Bearer) or X-API-Key."""
    scheme, _, key = headers.get("authorization", "").strip().partition(" ")
    if scheme.lower() == "bearer":
        return key.strip()
    return headers.get("x-api-key")


def token_in(headers: Headers) -> str | None:
    """The session token in the cookie."""
    return cookie_parser(headers.get("cookie", "")).get(COOKIE)
