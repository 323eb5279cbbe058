"""The cache warmer: points and match records in memory before a query asks for them.

It works at the start, and as shapes arrive.
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from time import monotonic
from typing import Any, TypeVar

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.arrays import Ints
from service.compute.tasks import example_records, warm_comparing
from service.container import Container
from service.errors import ServiceError
from service.index.cache import ABOUT, POINTS_BYTES, EmbeddingCache
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline
from service.search.match_records import cached_match_records, cached_points
from service.search.pgvector_repository import latest

log = get_logger("search")

Done = TypeVar("Done")

SECONDS, WARM_SECONDS = 0.5, 0.05
"""Seconds between looks for new shapes, and for a warm worker."""

FIRST_SECONDS = 5.0
"""The longest time that the service is not ready while it caches the stored embeddings at its start."""

LEAST_SHARE = 4
"""Points and match records have at least this part (one in four) of the memory for searching."""

POINTS_SHARE = 7 / 8
"""The largest share of the points in the room of both caches: a query re-ranks many more shapes than it
compares in full."""

AT_ONCE, POINTS_AT_ONCE = 16, 256


class CacheWarmer:
    """Fills the caches of the active pipeline, the newest embeddings first, one thread at a time.

    Embeddings beyond the room of a cache wait for a query that needs them, and the cache warmer waits for
    running queries. Points are cached where queries are re-ranked, before match records.
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
                active_pipeline, points, records = await _whole(run_in_threadpool(self._missing))
                batches = [
                    *_batches(self._put_points, points, POINTS_AT_ONCE),
                    *_batches(self._put_records, records, AT_ONCE),
                ]
                for put, numbers in batches:
                    await self._container.searches.until_idle()
                    await _whole(run_in_threadpool(put, active_pipeline, numbers))
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
                    records = await self._container.queue.do(example_records, parameters)
                    await _whole(run_in_threadpool(warm_comparing, records, parameters))
                    warm = True
            await asyncio.sleep(WARM_SECONDS)

    def _active(self) -> ActivePipeline:
        with self._container.database.read() as session:
            return self._container.pipelines.current(session)

    def _missing(self) -> tuple[ActivePipeline, list[int], list[int]]:
        """The embeddings that the cache of points and that of match records lack and have room for."""
        settings, descriptors = self._container.settings, self._container.descriptors
        with self._container.database.read() as session:
            active_pipeline = self._container.pipelines.current(session)
            if not active_pipeline.pipeline.matcher.uses_match_records:
                return active_pipeline, [], []
            most = room = settings.search_bytes
            if settings.signatures == "database":
                embeddings = np.array(latest(session, active_pipeline.fingerprint, most // ABOUT)[::-1])
            else:
                entries = active_pipeline.index.current(session)
                embeddings = entries.embeddings
                seen = (active_pipeline.fingerprint, active_pipeline.index.revision)
                if seen != self._seen:
                    active_pipeline.cache.keep(embeddings)
                    active_pipeline.points.keep(embeddings)
                    descriptors.keep(embeddings)
                    self._seen = seen
                room -= entries.nbytes
        room = max(room - descriptors.nbytes, most // LEAST_SHARE)
        of_points = 0
        if len(embeddings) >= settings.shortlist_from:
            of_points = min(POINTS_BYTES * len(embeddings), int(POINTS_SHARE * room))
        active_pipeline.points.resize(of_points)
        active_pipeline.cache.resize(room - of_points)
        points = self._wanted(active_pipeline.points, embeddings)
        return active_pipeline, points, self._wanted(active_pipeline.cache, embeddings)

    def _wanted(self, cache: EmbeddingCache[Any], embeddings: Ints) -> list[int]:
        """The embeddings that a cache lacks, the last ones first, as many as it has room for."""
        places = cache.free_places()
        if places <= 0 or len(cache) >= len(embeddings):
            return []
        newest = dict.fromkeys(embeddings[::-1].tolist())
        return [number for number in cache.missing(newest) if number not in self._unusable][:places]

    def _put_points(self, active_pipeline: ActivePipeline, numbers: list[int]) -> None:
        found = cached_points(self._container.database, active_pipeline.points, numbers)
        self._unusable.update(number for number in numbers if number not in found)

    def _put_records(self, active_pipeline: ActivePipeline, numbers: list[int]) -> None:
        cached = cached_match_records(
            self._container.database, active_pipeline.cache, active_pipeline.pipeline.parameters, numbers
        )
        self._unusable.update(number for number in numbers if number not in cached)


def _batches(
    put: Callable[[ActivePipeline, list[int]], None], numbers: list[int], length: int
) -> list[tuple[Callable[[ActivePipeline, list[int]], None], list[int]]]:
    """The numbers in batches, each with the function that caches them."""
    return [(put, numbers[start : start + length]) for start in range(0, len(numbers), length)]


async def _whole(work: Awaitable[Done]) -> Done:
    """The result of a thread, waited for even after a cancellation: it may be reading the database."""
    begun = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(begun)
    except asyncio.CancelledError:
        await asyncio.wait([begun])
        raise
