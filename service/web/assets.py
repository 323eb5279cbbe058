"""The files that a browser is sent: package data, read once, with what is said of them in headers."""

import gzip
import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

MEDIA_TYPES = {
    "css": "text/css; charset=utf-8",
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "png": "image/png",
    "svg": "image/svg+xml",
    "txt": "text/plain; charset=utf-8",
}

# Scripts, styles, pictures and answers of this service alone; nothing written into the page itself is run.
POLICY = "; ".join(
    [
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    ]
)


@dataclass(frozen=True)
class Asset:
    """A file as it is sent."""

    data: bytes
    packed: bytes
    media_type: str

    @property
    def tag(self) -> str:
        """The ETag of its bytes."""
        return f'"{hashlib.sha256(self.data).hexdigest()[:32]}"'


def find(name: str) -> Asset | None:
    """The file with a name such as `main.js` or `vendor/three.js`; None where there is none."""
    return load(name) if name in names() else None


@cache
def load(name: str) -> Asset:
    """A file that is there."""
    data = _folder().joinpath(name).read_bytes()
    # A compressed file holds the time unless it is told one.
    return Asset(data, gzip.compress(data, mtime=0), MEDIA_TYPES[name.rpartition(".")[2]])


@cache
def names() -> frozenset[str]:
    """Every file that is sent; those of other kinds beside them are not."""
    found = set()
    for folder in ("", "vendor/"):
        for entry in _folder().joinpath(folder).iterdir():
            if entry.name.rpartition(".")[2] in MEDIA_TYPES:
                found.add(folder + entry.name)
    return frozenset(found)


def _folder() -> Traversable:
    return files("service.web").joinpath("static")
