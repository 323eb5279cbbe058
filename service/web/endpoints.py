"""The addresses of the page and of the documentation. Anybody may ask for them: they hold no data."""

from fastapi import APIRouter, HTTPException, Request, Response

from service.web import assets
from service.web.answers import page, send

router = APIRouter(include_in_schema=False)


@router.get("/")
def read_page(request: Request) -> Response:
    """The page."""
    return page(request, "index.html")


@router.get("/docs")
def read_documentation(request: Request) -> Response:
    """The OpenAPI document as a page to read and try."""
    return page(request, "docs.html")


@router.get("/page/{name:path}")
def read_page_file(name: str, request: Request) -> Response:
    """A script, style or picture of the page."""
    asset = assets.find(name)
    if asset is None:
        raise HTTPException(404)
    return send(request, asset)
