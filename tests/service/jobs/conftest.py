"""Shapes that are held back, for the tests of jobs."""

import threading
from collections.abc import Iterator

import pytest

from service.shapes import service as shapes_service


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Shapes are stored only when this is set."""
    go_on = threading.Event()
    store = shapes_service._store

    def wait_and_store(*arguments: object) -> object:
        go_on.wait(300)
        return store(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(shapes_service, "_store", wait_and_store)
    yield go_on
    go_on.set()
