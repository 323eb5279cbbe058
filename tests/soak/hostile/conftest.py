"""One `isoshape serve` for the tests of a module."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest

from tests.service.processes import server

LIMIT_SECONDS = 180.0
"""The longest that a file may be worked on: the service's own limits of time are shorter together."""


class Served(NamedTuple):
    """A service that is a process of its own."""

    pid: int
    client: httpx.Client
    folder: Path


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Served]:
    """A service of two workers, with the `SETTINGS` of the module if it has any."""
    folder = tmp_path_factory.mktemp("hostile")
    settings = {"ISOSHAPE_WORKERS": "2", "ISOSHAPE_LOG_LEVEL": "warning"}
    settings |= getattr(request.module, "SETTINGS", {})
    with server(folder, answer_seconds=LIMIT_SECONDS, **settings) as (process, client):
        yield Served(process.pid, client, folder)
