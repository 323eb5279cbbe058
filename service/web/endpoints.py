"""The page at / and the documentation at /docs: package data with their headers, open to anybody."""

import gzip
import hashlib
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files

from fastapi import APIRouter, HTTPException, Request, Response

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


_FOLDER = files("service.web").joinpath("static")


@dataclass(frozen=True)
class Asset:
    """A file as it is sent, and its ETag."""

    data: bytes
    packed: bytes
    media_type: str
    tag: str


@cache
def load(name: str) -> Asset:
    """Return the file with a name of `names`, such as `main.js` or `vendor/three.js`."""
    data = _FOLDER.joinpath(name).read_bytes()
    # A compressed file holds the time unless it is told one.
    packed, tag = gzip.compress(data, mtime=0), f'"{hashlib.sha256(data).hexdigest()[:32]}"'
    return Asset(data, packed, MEDIA_TYPES[name.rpartition(".")[2]], tag)


@cache
def names() -> frozenset[str]:
    """Return the names of all files that are sent; those of other kinds beside them are not."""
    return frozenset(
        folder + entry.name
        for folder in ("", "vendor/")
        for entry in _FOLDER.joinpath(folder).iterdir()
        if entry.name.rpartition(".")[2] in MEDIA_TYPES
    )


_ALWAYS = {"Referrer-Policy": "same-origin"}


def page(request: Request, name: str) -> Response:
    """Return an HTML file."""
    return send(request, load(name), {"Content-Security-Policy": POLICY})


def viewing_page(**told: str) -> Response:
    """Return the page of a shape, told its `collection`; with the ids `first` and `second`, of two shapes."""
    text = load("view.html").data.decode()
    if "first" in told:
        # It is sent from /compare, not from /shapes/<id>/view.
        text = text.replace("../../", "./")
    for name, value in told.items():
        text = text.replace(f'data-{name}=""', f'data-{name}="{escape(value)}"')
    headers = {"Content-Security-Policy": POLICY, **_ALWAYS}
    return Response(text, media_type="text/html", headers=headers)


def send(request: Request, asset: Asset, headers: dict[str, str] | None = None) -> Response:
    """Return a file, packed where the browser takes that; nothing where it has it already.

    A browser asks each time, so that a new version is seen at once, and has the answer without the file.
    """
    headers = {
        **(headers or {}),
        "Cache-Control": "no-cache",
        "ETag": asset.tag,
        "Vary": "Accept-Encoding",
        **_ALWAYS,
    }
    known = request.headers.get("if-none-match", "")
    if asset.tag in [part.strip().removeprefix("W/") for part in known.split(",")]:
        return Response(status_code=304, headers=headers)
    data = asset.data
    accepted = [
        part.partition(";")[0].strip() for part in request.headers.get("accept-encoding", "").split(",")
    ]
    if "gzip" in accepted and len(asset.packed) < len(data):
        data, headers["Content-Encoding"] = asset.packed, "gzip"
    return Response(data, media_type=asset.media_type, headers=headers)


router = APIRouter(include_in_schema=False)


@router.get("/")
def read_page(request: Request) -> Response:
    """Return the page."""
    return page(request, "index.html")


@router.get("/docs")
def read_documentation(request: Request) -> Response:
    """Return the OpenAPI document as a page to read and try."""
    return page(request, "docs.html")


@router.get("/page/{name:path}")
def read_page_file(name: str, request: Request) -> Response:
    """Return a script, style or picture of the page."""
    if name not in names():
        raise HTTPException(404)
    return send(request, load(name))
