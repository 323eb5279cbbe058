"""Clients that work in a collection."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import httpx

from service.collections.endpoints import HEADER
from tests.service.support import Running


@contextmanager
def working_in(running: Running, name: str) -> Iterator[Running]:
    """The same service, by a client that names a collection in each request; it is made."""
    assert running.client.put(f"/collections/{name}").status_code in {200, 201}
    headers = {**running.client.headers, HEADER: name}
    with httpx.Client(base_url=running.client.base_url, headers=headers, timeout=120) as client:
        yield replace(running, client=client)
