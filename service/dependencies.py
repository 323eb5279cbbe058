"""What FastAPI gives to the endpoints."""

from typing import Annotated

from fastapi import Depends, Request

from service.container import Parts


def _parts(request: Request) -> Parts:
    parts = request.app.state.parts
    assert isinstance(parts, Parts)
    return parts


Service = Annotated[Parts, Depends(_parts)]
