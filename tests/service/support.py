"""A real service on loopback, and meshes to send to it."""

import asyncio
import multiprocessing
import threading
import time
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import httpx
import numpy as np
import pytest
import uvicorn
from sqlalchemy import ColumnElement, func, select

from core.io import write_mesh
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from service.app import create_app, openapi_document
from service.collections.endpoints import HEADER
from service.container import Container
from service.duplicates.service import find_neighbours
from service.server.uvicorn_server import config
from service.settings import Settings
from service.storage.tables import Table
from service.turns import Place
from tests.service.engines import url_in

T = TypeVar("T")

END_SECONDS = 120.0
"""The longest that a service may take to end, or to do work in its event loop."""

document = cache(openapi_document)
"""The OpenAPI document, made once for all tests."""


@cache
def operations() -> dict[tuple[str, str], dict[str, Any]]:
    """The operations of the document, by method and path."""
    paths = document()["paths"].items()
    return {(method.upper(), path): each for path, methods in paths for method, each in methods.items()}


@dataclass(frozen=True)
class Running:
    """A service that answers, and its insides."""

    client: httpx.Client
    container: Container
    server: uvicorn.Server

    def store(self, data: bytes, filename: str = "shape.off", **fields: Any) -> dict[str, Any]:
        """Upload a file; the record."""
        answer = upload(self.client, data, filename, **fields)
        assert answer.status_code in {200, 201}, answer.text
        about_the_upload = {"created", "changed"}
        return {name: value for name, value in answer.json().items() if name not in about_the_upload}

    def rows(self, table: type[Table], *conditions: ColumnElement[bool]) -> int:
        """Return the number of rows of a table that satisfy conditions."""
        with self.container.database.read() as session:
            query = select(func.count()).select_from(table).where(*conditions)
            return session.scalar(query) or 0

    def clear(self, *, permanent: bool = True) -> None:
        """Delete every shape."""
        wanted = {"permanent": permanent}
        while shapes := self.client.get("/shapes", params={"limit": 500}).json()["shapes"]:
            for shape in shapes:
                assert self.client.delete(f"/shapes/{shape['id']}", params=wanted).status_code == 204


def settings_in(folder: Path, **values: Any) -> Settings:
    """Settings with a folder's archive by the engine in use.

    Unless said otherwise, there is one worker, deletions are for good, and no duplicates are sought in the
    background.
    """
    return Settings(
        **{
            "database_url": url_in(folder),
            "job_folder": str(folder / "jobs"),
            "workers": 1,
            "undo_days": 0.0,
            "duplicates_in_background": False,
            "log_level": "error",
            **values,
        }
    )


@contextmanager
def serving(
    settings: Settings,
    *,
    ready: bool = True,
    key: str | None = None,
    connections: int | None = None,
    watches: bool = False,
) -> Iterator[Running]:
    """Run the service under some settings, and wait for its workers unless told not to."""
    app = create_app(settings, watches=watches)
    configured = config(app, settings.shutdown_seconds)
    configured.port = 0
    configured.limit_concurrency = connections or configured.limit_concurrency
    server = uvicorn.Server(configured)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        wait_until(lambda: server.started or not thread.is_alive(), seconds=60)
        assert server.started, "the service did not start"
        port = server.servers[0].sockets[0].getsockname()[1]
        headers = {} if key is None else {"authorization": f"Bearer {key}"}
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", headers=headers, timeout=120) as client:
            if ready:
                wait_until(lambda: client.get("/readyz").status_code == 200, seconds=180)
            yield Running(client, app.state.container, server)
    finally:
        server.should_exit = True
        thread.join(END_SECONDS)
        assert not thread.is_alive(), f"the service does not end: {standing(server)}"


def standing(server: uvicorn.Server) -> list[str]:
    """Where each task of a service's event loop waits."""
    found = []
    for task in asyncio.all_tasks(server.servers[0].get_loop()) if server.servers else ():
        frames, waiting = [], task.get_coro()
        while (frame := getattr(waiting, "cr_frame", None)) is not None:
            frames.append(f"{frame.f_code.co_qualname}:{frame.f_lineno}")
            waiting = waiting.cr_await
        found.append(" > ".join(frames))
    return found


def on_loop(running: Running, work: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine in the event loop of a service, which its parts belong to."""
    return asyncio.run_coroutine_threadsafe(work, running.server.servers[0].get_loop()).result(END_SECONDS)


def relate(running: Running, workers: int = 1) -> None:
    """Find the neighbours of every shape, as the background does with some workers."""
    settings = running.container.settings.model_copy(update={"workers": workers})
    container = replace(running.container, settings=settings)
    with container.database.read() as session:
        active_pipeline = container.pipelines.current(session)
    while on_loop(running, find_neighbours(container, active_pipeline)):
        pass


@contextmanager
def requests_at_work(running: Running, many: int) -> Iterator[None]:
    """Have so many places in the queue, as requests at work have them."""
    turns = running.container.queue._requests

    async def ask() -> list[Place]:
        return [turns.ask() for _ in range(many)]

    async def leave() -> None:
        for place in places:
            turns.leave(place)

    places = on_loop(running, ask())
    assert all(place.held for place in places)
    try:
        yield
    finally:
        on_loop(running, leave())


def module_service(
    *, ready: bool = True, key: str | None = None, stored: Mapping[str, bytes] | None = None, **values: Any
) -> Any:
    """Return a fixture: a module's own service, under some settings, that holds OFF files by their names."""

    @pytest.fixture(scope="module")
    def running(tmp_path_factory: pytest.TempPathFactory, engine: str) -> Iterator[Running]:
        settings = settings_in(tmp_path_factory.mktemp("service"), **values)
        with serving(settings, ready=ready, key=key) as running:
            for name, data in (stored or {}).items():
                running.store(data, name=name)
            yield running

    return running


@contextmanager
def working_in(running: Running, name: str) -> Iterator[Running]:
    """The same service, by a client that names a collection in each request; it is made."""
    assert running.client.put(f"/collections/{name}").status_code in {200, 201}
    headers = {**running.client.headers, HEADER: name}
    with httpx.Client(base_url=running.client.base_url, headers=headers, timeout=120) as client:
        yield replace(running, client=client)


def wait_until(condition: Callable[[], object], *, seconds: float) -> None:
    """Wait for a condition, or fail."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def children() -> set[int | None]:
    """The process ids of the workers that this process has started, and which are not over."""
    return {child.pid for child in multiprocessing.active_children()}


@cache
def small_file(number: int, format: str = "off") -> bytes:
    """A closed, bumpy ball of 122 vertices as a file: quick to embed, and unlike that of any other number."""
    rings, around = 10, 12
    polar = np.pi * np.arange(1, rings + 1)[:, None] / (rings + 1)
    azimuth = 2 * np.pi * np.arange(around) / around
    ring = np.stack(
        np.broadcast_arrays(np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)),
        -1,
    )
    points = np.vstack([ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    waves = np.random.default_rng(number).normal(size=(4, 3))
    points *= (1 + 0.15 * np.sin(2 * points @ waves.T).sum(axis=1))[:, None]
    south, north = rings * around + 1, rings * around
    faces = []
    for j in range(around):
        k = (j + 1) % around
        faces += [[north, j, k], [south, (rings - 1) * around + k, (rings - 1) * around + j]]
        for i in range(rings - 1):
            a, b, c, d = i * around + j, i * around + k, (i + 1) * around + j, (i + 1) * around + k
            faces += [[a, c, b], [b, c, d]]
    return write_mesh(Mesh(points, np.array(faces)), format)


def pipeline_in_use(running: Running) -> Pipeline:
    """The pipeline that the service's archive is searched by."""
    with running.container.database.read() as session:
        return running.container.pipelines.current(session).pipeline


def upload(client: httpx.Client, data: bytes, filename: str, **fields: Any) -> httpx.Response:
    """POST /shapes with a file and text fields."""
    return client.post("/shapes", files={"file": (filename, data)}, data=fields)


def query(client: httpx.Client, data: bytes, filename: str = "query.off", **fields: Any) -> httpx.Response:
    """POST /query with a file and text fields."""
    return client.post("/query", files={"file": (filename, data)}, data=fields)


def assert_problem(answer: httpx.Response, status: int, kind: str) -> dict[str, Any]:
    """Check that an answer is a problem document in the one form that all have; the document."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["type"] == f"urn:isoshape:problem:{kind}", problem
    assert set(problem) - {"errors"} == {"type", "title", "status", "detail", "instance", "request_id"}
    assert problem["status"] == status
    assert problem["title"]
    assert problem["detail"]
    assert problem["request_id"] == answer.headers["x-request-id"]
    assert problem["instance"] == f"urn:isoshape:request:{problem['request_id']}"
    assert ("retry-after" in answer.headers) == (status in {429, 503, 507})
    return problem
