"""Files of the page as answers."""

from html import escape

from fastapi import Request, Response

from service.web import assets
from service.web.assets import Asset

_ALWAYS = {"Referrer-Policy": "same-origin", "X-Content-Type-Options": "nosniff"}


def page(request: Request, name: str) -> Response:
    """An HTML file."""
    return send(request, assets.load(name), {"Content-Security-Policy": assets.POLICY})


def viewing_page(collection: str) -> Response:
    """The page of a shape, told the collection that the shape is in."""
    return _filled(_view(collection=collection))


def comparing_page(first: str, second: str, collection: str) -> Response:
    """The page of a shape with two of a collection in it, by their ids."""
    # It is sent from /compare, not from /shapes/<id>/view.
    return _filled(_view(first=first, second=second, collection=collection).replace("../../", "./"))


def _view(**told: str) -> str:
    text = assets.load("view.html").data.decode()
    for name, value in told.items():
        text = text.replace(f'data-{name}=""', f'data-{name}="{escape(value)}"')
    return text


def _filled(text: str) -> Response:
    headers = {"Content-Security-Policy": assets.POLICY, **_ALWAYS}
    return Response(text, media_type="text/html", headers=headers)


def send(request: Request, asset: Asset, headers: dict[str, str] | None = None) -> Response:
    """A file, packed where the browser takes that; nothing where it has it already.

    A browser asks each time, so that a new version is seen at once, and has the answer without the file.
    """
    headers = {
        **(headers or {}),
        "Cache-Control": "no-cache",
        "ETag": asset.tag,
        "Vary": "Accept-Encoding",
        **_ALWAYS,
    }
    given = request.headers.get("if-none-match", "")
    if asset.tag in [part.strip().removeprefix("W/") for part in given.split(",")]:
        return Response(status_code=304, headers=headers)
    data = asset.data
    accepted = [
        part.partition(";")[0].strip() for part in request.headers.get("accept-encoding", "").split(",")
    ]
    if "gzip" in accepted and len(asset.packed) < len(data):
        data, headers["Content-Encoding"] = asset.packed, "gzip"
    return Response(data, media_type=asset.media_type, headers=headers)
