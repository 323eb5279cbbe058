"""What each request needs. Whatever is not named here needs a key, so that a new address is closed."""

from urllib.parse import urlsplit

from starlette.datastructures import Headers

from service.auth.keys import Level

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})

# Probes, the documentation of the interface, and what a browser needs before it has signed in.
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

# The files of the page, which hold no data.
PAGE_FILES = "/page/"

# They send something, and change nothing that is stored.
READING_POSTS = frozenset({"/query", "/compare", "/preview", "/session"})


# Of the whole service, whatever collection: not for a key that is limited to some.
OF_ALL_COLLECTIONS = frozenset({"/metrics"})


def of_all_collections(method: str, path: str) -> bool:
    """Whether a request needs a key that is limited to no collections."""
    return path in OF_ALL_COLLECTIONS or (path.startswith("/collections/") and method not in SAFE_METHODS)


def needed(method: str, path: str) -> Level | None:
    """The level that a request needs; None for one that anybody may make."""
    if ("GET" if method == "HEAD" else method, path) in PUBLIC:
        return None
    if method in SAFE_METHODS and path.startswith(PAGE_FILES):
        return None
    if method in SAFE_METHODS or (method == "POST" and path in READING_POSTS):
        return "read"
    return "full"


def from_another_site(headers: Headers) -> bool:
    """Whether a browser sends this for a page of another site, as far as browsers tell.

    Current ones say so in Sec-Fetch-Site; older ones name the page's origin, which is then compared with the
    address that the request itself went to. Programs that are no browsers send neither.
    """
    site = headers.get("sec-fetch-site")
    if site is not None:
        return site not in {"same-origin", "none"}
    origin = headers.get("origin")
    return origin is not None and urlsplit(origin).netloc != headers.get("host", "")
