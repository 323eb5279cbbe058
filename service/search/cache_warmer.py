"""Embeddings made ready to be compared before a query asks for them: at the start, and as shapes come."""

import asyncio
from collections.abc import Awaitable
from contextlib import suppress
from time import monotonic
from typing import TypeVar

from starlette.concurrency import run_in_threadpool

from service.compute.tasks import example_records, warm_comparing
from service.compute.workers import RemoteWorkers
from service.container import Container
from service.errors import ServiceError
from service.index.cache import ABOUT
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline
from service.search.match_records import cached_bytes
from service.search.pgvector_repository import latest

log = get_logger("search")

Done = TypeVar("Done")

SECONDS, WARM_SECONDS = 0.5, 0.05
"""How often is looked for what has come, and for a worker that is warm."""

FIRST_SECONDS = 5.0
"""How long the service counts as not ready while it makes ready what is stored at its start."""

LEAST_SHARE = 4
"""Of the memory for searching, the part that rows have at least, however much signatures, sketches and
patches take."""

AT_ONCE = 16


class CacheWarmer:
    """Fills the room of the shelf in use, the newest embeddings first, one thread at a time.

    What has no room waits for a query that needs it, and this for queries that are at work. Where workers
    keep embeddings of their own, nothing is made ready here.
    """

    def __init__(self, container: Container) -> None:
        self._container = container
        self._task: asyncio.Task[None] | None = None
        # Numbers are never used again.
        self._unusable: set[int] = set()
        self._seen: tuple[str, int] | None = None

    def start(self) -> None:
        """Begin, in the running loop."""
        self._task = asyncio.create_task(self._run(), name="stocking")

    async def stop(self) -> None:
        """End after what is being made."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task

    async def _run(self) -> None:
        await self._warm()
        ready, latest = self._container.comparing_is_ready, monotonic() + FIRST_SECONDS
        while True:
            # Whatever else goes wrong, queries are answered without what would be ready.
            try:
                active_pipeline, missing = await _whole(run_in_threadpool(self._missing))
                for start in range(0, len(missing), AT_ONCE):
                    await self._container.searches.nothing()
                    await _whole(
                        run_in_threadpool(self._put, active_pipeline, missing[start : start + AT_ONCE])
                    )
                    if monotonic() > latest:
                        ready.set()
                ready.set()
            except ServiceError:
                pass
            except Exception:
                log.exception("embeddings could not be made ready")
                ready.set()
            await asyncio.sleep(SECONDS)

    async def _warm(self) -> None:
        """Load what a search runs once a worker has compiled it, so that no query waits for that."""
        warm = False
        while not warm:
            if self._container.pool.pids():
                # A lost worker, and storage that is away, are told of to those who ask.
                with suppress(ServiceError):
                    parameters = (await _whole(run_in_threadpool(self._active))).pipeline.parameters
                    records = await self._container.work.do(example_records, parameters)
                    await _whole(run_in_threadpool(warm_comparing, records, parameters))
                    warm = True
            await asyncio.sleep(WARM_SECONDS)

    def _active(self) -> ActivePipeline:
        with self._container.database.read() as session:
            return self._container.pipelines.current(session)

    def _missing(self) -> tuple[ActivePipeline, list[int]]:
        """The numbers of embeddings that are not on the shelf and for which there is room."""
        with self._container.database.read() as session:
            active_pipeline = self._container.pipelines.current(session)
            if active_pipeline.pipeline.parameters.matching.pairs != "both-ways" or isinstance(
                self._container.pool, RemoteWorkers
            ):
                return active_pipeline, []
            most = self._container.settings.search_bytes
            if self._container.settings.signatures == "database":
                newest, room = latest(session, active_pipeline.fingerprint, most // ABOUT), most
            else:
                entries = active_pipeline.index.current(session)
                seen = (active_pipeline.fingerprint, active_pipeline.index.revision)
                if seen != self._seen:
                    active_pipeline.cache.keep(entries.embeddings)
                    self._container.spin_images.keep(entries.embeddings)
                    self._seen = seen
                newest = entries.embeddings[::-1].tolist()
                room = most - entries.nbytes
        cache = active_pipeline.cache
        cache.resize(max(room - self._container.spin_images.nbytes, most // LEAST_SHARE))
        places = cache.free_places()
        if not places or len(cache) >= len(newest):
            return active_pipeline, []
        wanted = cache.missing(dict.fromkeys(newest))
        return active_pipeline, [number for number in wanted if number not in self._unusable][:places]

    def _put(self, active_pipeline: ActivePipeline, numbers: list[int]) -> None:
        rows = cached_bytes(
            self._container.database, active_pipeline.cache, active_pipeline.pipeline.parameters, numbers
        )
        self._unusable.update(number for number in numbers if number not in rows)


async def _whole(work: Awaitable[Done]) -> Done:
    """What a thread does, waited for even when this is cancelled: it may be reading the database."""
    begun = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(begun)
    except asyncio.CancelledError:
        await asyncio.wait([begun])
        raise
