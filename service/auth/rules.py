"""The access level of each path. A path without a rule needs full access."""

from urllib.parse import urlsplit

from starlette.datastructures import Headers

from service.auth.keys import Level

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})

# Probes know an address of the service, and no name.
PROBES = frozenset({"/healthz", "/readyz"})

# Health probes, the documentation, and the addresses that a browser needs before it signs in.
PUBLIC = frozenset(
    {
        ("GET", "/"),
        ("GET", "/docs"),
        ("GET", "/openapi.json"),
        ("GET", "/healthz"),
        ("GET", "/readyz"),
        ("GET", "/session"),
        ("DELETE", "/session"),
    }
)

# Static files of the page, without data.
PAGE_FILES = "/page/"

# POST requests that change no stored data.
READING_POSTS = frozenset({"/query", "/compare", "/preview", "/session"})


# Addresses about all collections: a key for some collections has no access.
OF_ALL_COLLECTIONS = frozenset({"/metrics"})


def of_all_collections(method: str, path: str) -> bool:
    """Whether a request needs a key for all collections."""
    return path in OF_ALL_COLLECTIONS or (path.startswith("/collections/") and method not in SAFE_METHODS)


def needed(method: str, path: str) -> Level | None:
    """The access level that a request needs; None for a public path."""
    if ("GET" if method == "HEAD" else method, path) in PUBLIC:
        return None
    if method in SAFE_METHODS and path.startswith(PAGE_FILES):
        return None
    if method in SAFE_METHODS or (method == "POST" and path in READING_POSTS):
        return "read"
    return "full"


def from_another_site(headers: Headers) -> bool:
    """Whether a browser sends the request for a page of another site.

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
