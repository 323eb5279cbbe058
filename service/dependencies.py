"""The container as a dependency of endpoints."""

from typing import Annotated

from fastapi import Depends, Request

from service.container import Container


def _container(request: Request) -> Container:
    container = request.app.state.container
    assert isinstance(container, Container)
    return container


Service = Annotated[Container, Depends(_container)]
