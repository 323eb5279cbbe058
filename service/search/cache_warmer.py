"""The cache warmer: match records made before a query asks for them, at the start and as shapes arrive."""

import asyncio
from collections.abc import Awaitable
from contextlib import suppress
from time import monotonic
from typing import TypeVar

from starlette.concurrency import run_in_threadpool

from service.compute.tasks import example_records, warm_comparing
from service.compute.workers_interface import RemoteWorkers
from service.container import Container
from service.errors import ServiceError
from service.index.cache import ABOUT
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline
from service.search.match_records import cached_match_records
from service.search.pgvector_repository import latest

log = get_logger("search")

Done = TypeVar("Done")

SECONDS, WARM_SECONDS = 0.5, 0.05
"""Seconds between looks for new shapes, and for a warm worker."""

FIRST_SECONDS = 5.0
"""The longest time that the service is not ready while it caches the stored embeddings at its start."""

LEAST_SHARE = 4
"""The match records have at least this part (one in four) of the memory for searching."""

AT_ONCE = 16


class CacheWarmer:
    """Fills the cache of the active pipeline, the newest embeddings first, one thread at a time.

    Embeddings beyond the room of the cache wait for a query that needs them, and the cache warmer waits for
    running queries. If workers of a cluster cache match records, nothing is cached here.
    """

    def __init__(self, container: Container) -> None:
        self._container = container
        self._task: asyncio.Task[None] | None = None
        # Numbers are never used again.
        self._unusable: set[int] = set()
        self._seen: tuple[str, int] | None = None

    def start(self) -> None:
        """Begin, in the running loop."""
        self._task = asyncio.create_task(self._run(), name="cache-warmer")

    async def stop(self) -> None:
        """End after the batch at work."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task

    async def _run(self) -> None:
        await self._warm()
        ready, latest = self._container.comparing_is_ready, monotonic() + FIRST_SECONDS
        while True:
            # After any other error, queries are answered without a warm cache.
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
        """Load the kernels of a search once a worker has compiled them, so that no query waits for them."""
        warm = False
        while not warm:
            if self._container.pool.pids():
                # Requests report a lost worker and unreachable storage.
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
        """The numbers of embeddings that are not cached and for which there is room."""
        with self._container.database.read() as session:
            active_pipeline = self._container.pipelines.current(session)
            cached_here = active_pipeline.pipeline.matcher.uses_match_records
            if not cached_here or isinstance(self._container.pool, RemoteWorkers):
                return active_pipeline, []
            most = self._container.settings.search_bytes
            if self._container.settings.signatures == "database":
                newest, room = latest(session, active_pipeline.fingerprint, most // ABOUT), most
            else:
                entries = active_pipeline.index.current(session)
                seen = (active_pipeline.fingerprint, active_pipeline.index.revision)
                if seen != self._seen:
                    active_pipeline.cache.keep(entries.embeddings)
                    self._container.descriptors.keep(entries.embeddings)
                    self._container.spin_images.keep(entries.embeddings)
                    self._seen = seen
                newest = entries.embeddings[::-1].tolist()
                room = most - entries.nbytes
        cache = active_pipeline.cache
        described = self._container.descriptors.nbytes + self._container.spin_images.nbytes
        cache.resize(max(room - described, most // LEAST_SHARE))
        places = cache.free_places()
        if not places or len(cache) >= len(newest):
            return active_pipeline, []
        wanted = cache.missing(dict.fromkeys(newest))
        return active_pipeline, [number for number in wanted if number not in self._unusable][:places]

    def _put(self, active_pipeline: ActivePipeline, numbers: list[int]) -> None:
        cached = cached_match_records(
            self._container.database, active_pipeline.cache, active_pipeline.pipeline.parameters, numbers
        )
        self._unusable.update(number for number in numbers if number not in cached)


async def _whole(work: Awaitable[Done]) -> Done:
    """The result of a thread, waited for even after a cancellation: it may be reading the database."""
    begun = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(begun)
    except asyncio.CancelledError:
        await asyncio.wait([begun])
        raise
