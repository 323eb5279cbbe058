"""The service in this process: ASGI without sockets, and tasks done at once instead of by other processes.

Workers and readers write nothing. What a start and a task take longest for is done before processes fork.
"""

import asyncio
import random
import tempfile
import uuid
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future
from contextlib import ExitStack, asynccontextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any
from unittest.mock import patch

import httpx
import numpy as np

import service.app
import service.compute.sandbox
import service.jobs.repository
import service.jobs.runner
import service.search.caches
import service.sources.repository
import service.sources.scanner
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from service.compute.tasks import example_records, warm_comparing
from tests.service.support import settings_in

CLOCKS = (
    (service.jobs.runner, "LOOK_SECONDS"),
    (service.jobs.runner, "IDLE_SECONDS"),
    (service.jobs.runner, "BEAT_SECONDS"),
    (service.sources.scanner, "LOOK_SECONDS"),
    (service.sources.scanner, "PROGRESS_SECONDS"),
)
"""The intervals at which jobs and scans are looked for, and at which their leases are renewed."""


class Executor:
    """Does tasks in the calling thread, and none twice: in the place of workers and readers."""

    def __init__(self) -> None:
        self._results: dict[Any, Any] = {}

    def submit(self, function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        key = function, *(_key(argument) for argument in arguments if not isinstance(argument, float))
        try:
            if key not in self._results:
                self._results[key] = function(*arguments)
            future.set_result(self._results[key])
        except Exception as error:
            future.set_exception(error)
        return future

    def pids(self) -> list[int]:
        return [0]

    def ready(self) -> bool:
        return True

    def kill(self) -> None:
        pass


def _key(argument: object) -> object:
    if isinstance(argument, Mesh):
        return np.asarray(argument.vertices).tobytes()
    return tuple(argument) if isinstance(argument, list) else argument


class InlineService:
    """The service on the archive in a folder, which starts and ends as often as it is asked to."""

    def __init__(self, folder: Path) -> None:
        executor = Executor()
        warm_comparing(executor.submit(example_records, DEFAULT).result(), DEFAULT)
        service.search.caches.warm_comparing = lambda *_: None  # type: ignore[assignment]
        service.search.caches.WARM_SECONDS = 0.0
        service.app.start_executors = lambda *_: (executor, executor)  # type: ignore[assignment,return-value]
        # The limit of a reader's time would end this process.
        service.compute.sandbox._limit_time = lambda _: None  # type: ignore[assignment]
        # Jobs and scans wait for no lease of the service that was killed, and not for long after a fault.
        service.jobs.repository.LEASE = service.sources.repository.LEASE = timedelta(0)
        service.jobs.runner.PAUSES = (0.01,)  # type: ignore[assignment]
        service.sources.scanner.PAUSE_SECONDS = 0.01
        service.jobs.runner.LOOK_SECONDS = service.jobs.runner.IDLE_SECONDS = 0.05
        service.sources.scanner.LOOK_SECONDS = 0.05
        # The same in each run, so that the same pages of the database change.
        uuid.uuid4 = lambda: uuid.UUID(int=random.getrandbits(128), version=4)
        tempfile.tempdir = str(folder / "tmp")
        # The database syncs the folder that it is in, and no other.
        jobs = str(folder / "elsewhere" / "jobs")
        self._app = service.app.create_app(
            settings_in(
                folder, job_folder=jobs, undo_days=7.0, lock_seconds=2.0, source_roots=(str(folder.parent),)
            )
        )
        # The first request builds the routes.
        asyncio.run(httpx.AsyncClient(transport=httpx.ASGITransport(self._app)).get("http://127.0.0.1/none"))

    @asynccontextmanager
    async def client(self, *, is_timed: bool = True) -> AsyncIterator[httpx.AsyncClient]:
        """Run the service, and yield a client of it.

        Unless it is timed, jobs and scans begin at its start and when they are asked for, and renew no lease:
        its writes do not depend on the load of the machine.
        """
        transport = httpx.ASGITransport(self._app, raise_app_exceptions=False)
        with ExitStack() as clocks:
            for module, name in () if is_timed else CLOCKS:
                clocks.enter_context(patch.object(module, name, 1e6))
            async with (
                self._app.router.lifespan_context(self._app),
                httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client,
            ):
                yield client
