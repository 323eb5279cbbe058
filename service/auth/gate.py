"""The access decision for each request: key or session, access level, collections, names and rate limit."""

import ipaddress
import math
import time
from collections.abc import Callable, Collection
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import cookie_parser

from service.auth.keys import COOKIE, Grant, KeyRing, Level, Sessions
from service.errors import (
    CrossSiteError,
    ForbiddenError,
    MisdirectedRequestError,
    RateLimitError,
    UnauthorizedError,
)


def name_in(host: str) -> str:
    """Return the name or address of a header Host, in lower case, without port, brackets and final dot."""
    name = host.strip().lower()
    if name.startswith("["):
        return name[1:].partition("]")[0]
    if name.count(":") > 1:
        # An IPv6 address without brackets, as settings have it.
        return name
    return name.partition(":")[0].removesuffix(".")


def is_loopback_name(name: str) -> bool:
    """Return whether a name stands for this machine alone: localhost or a loopback address."""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def check_host(headers: Headers, known: Collection[str] | None) -> None:
    """Refuse a request whose header Host has neither a known name nor one of the loopback interface.

    `known` has names in the form of `name_in`; None allows any name. Raise MisdirectedRequestError if the
    request names another host, or none.
    """
    names = [name_in(host) for host in headers.getlist("host")] or [""]
    for name in names:
        if not (known is None or name in known or is_loopback_name(name)):
            raise MisdirectedRequestError(
                f"this service does not answer as {name[:80]!r}; the setting ISOSHAPE_HOSTS adds a name"
            )


class RateLimit:
    """A rate limit per key: a burst of `per_minute` requests (0: no limit), and as many per minute after it.

    The generic cell rate algorithm (ITU-T I.371) on a monotonic clock stores one number per key and gives the
    exact time of the next admitted request. The library `limits` uses the wall clock and starts a thread per
    request.
    """

    def __init__(self, per_minute: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._interval = 60.0 / per_minute if per_minute else 0.0
        self._clock = clock
        self._empty_at: dict[str, float] = {}

    def wait(self, key: str) -> int | None:
        """Count a request: None if it is admitted, else the number of seconds until the next one is."""
        if not self._interval:
            return None
        now = self._clock()
        # The time at which the bucket, which loses one request per interval, becomes empty.
        empty_at = max(self._empty_at.get(key, now), now) + self._interval
        excess = empty_at - now - 60.0
        # The tolerance covers rounding of the sum of many intervals.
        if excess > 1e-6:
            return max(1, math.ceil(excess))
        self._empty_at[key] = empty_at
        return None


SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})

# Probes know an address of the service, and no name.
PROBES = frozenset({"/healthz", "/readyz"})

# Health probes, the documentation, and the addresses that a browser needs before it signs in.
PUBLIC = frozenset(
    {
        *(("GET", path) for path in ("/", "/docs", "/openapi.json", "/healthz", "/readyz", "/session")),
        ("DELETE", "/session"),
    }
)

# Static files of the page, without data.
PAGE_FILES = "/page/"

# POST requests that change no stored data.
READING_POSTS = frozenset({"/query", "/query/batch", "/compare", "/preview", "/session"})


def of_all_collections(method: str, path: str) -> bool:
    """Return whether a request needs a key for all collections."""
    return path == "/metrics" or (path.startswith("/collections/") and method not in SAFE_METHODS)


# Their answers hold paths of the machine, which reading keys must not see.
SOURCES, EQUAL_FILES = "/sources", "/equal-files"


def needed(method: str, path: str) -> Level | None:
    """Return the access level that a request needs; None for a public path."""
    if ("GET" if method == "HEAD" else method, path) in PUBLIC:
        return None
    if method in SAFE_METHODS and path.startswith(PAGE_FILES):
        return None
    if path in {SOURCES, EQUAL_FILES} or path.startswith(f"{SOURCES}/"):
        return "full"
    if method in SAFE_METHODS or (method == "POST" and path in READING_POSTS):
        return "read"
    return "full"


def from_another_site(headers: Headers) -> bool:
    """Return whether a browser sends the request for a page of another site.

    Current browsers send Sec-Fetch-Site. Older ones send the Origin of the page, which is compared with the
    Host of the request. Other programs send neither. An Origin that is no URL is another site's.
    """
    site = headers.get("sec-fetch-site")
    if site is not None:
        return site not in {"same-origin", "none"}
    origin = headers.get("origin")
    if origin is None:
        return False
    try:
        return urlsplit(origin).netloc != headers.get("host", "")
    except ValueError:
        return True


class Gate:
    """Keys, sessions, rate limits and names of one service.

    Use it in the event loop only: it has no locks. `hosts` has the names under which the service answers;
    None stands for any.
    """

    def __init__(self, keys: KeyRing, rate_limit: int, hosts: Collection[str] | None) -> None:
        self._keys = keys
        self._hosts = None if hosts is None else frozenset(map(name_in, hosts))
        self._rates = RateLimit(rate_limit)
        self.sessions = Sessions()

    def grant(self, headers: Headers) -> Grant | None:
        """Return the grant of a request, from its headers; None if it has neither a key nor an open session.

        Raise UnauthorizedError if the key is unknown, and MisdirectedRequestError if the session was opened
        under another name of the service.
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
        """Return the grant of an admitted request; None if its path is public.

        Raise MisdirectedRequestError if the request names another host, CrossSiteError if a page of another
        site caused a browser to send it, UnauthorizedError or ForbiddenError if it has no key, or a key that
        does not allow it, and RateLimitError if the key has exceeded its rate limit.
        """
        if not (self._keys and path in PROBES):
            check_host(headers, self._hosts)
        if method not in SAFE_METHODS and key_in(headers) is None and from_another_site(headers):
            raise CrossSiteError("pages of other sites cannot use this service")
        level = needed(method, path)
        if level is None:
            return None
        grant = self.grant(headers)
        if grant is None:
            raise UnauthorizedError("send a key as Authorization: Bearer, or as X-API-Key")
        if level == "full" and grant.level != "full":
            raise ForbiddenError("the key may read and query, but change nothing and see no paths")
        if grant.collections is not None and of_all_collections(method, path):
            raise ForbiddenError("the key is limited to some collections")
        if grant.digest is not None:
            seconds = self._rates.wait(grant.digest)
            if seconds is not None:
                raise RateLimitError("the key has made too many requests", retry_after=seconds)
        return grant


def key_in(headers: Headers) -> str | None:
    """Return the key in the header Authorization (scheme Bearer) or X-API-Key."""
    scheme, _, key = headers.get("authorization", "").strip().partition(" ")
    if scheme.lower() == "bearer":
        return key.strip()
    return headers.get("x-api-key")


def token_in(headers: Headers) -> str | None:
    """Return the session token in the cookie."""
    return cookie_parser(headers.get("cookie", "")).get(COOKIE)
