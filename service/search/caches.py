"""The parts of stored embeddings that queries read: match records and descriptors, cached in memory.

A query reads the embedding record of a candidate at most once (`CandidateReader`), and makes all that the
caches lack from it. The cache warmer fills the caches at the start, and as shapes arrive.
"""

import asyncio
from collections.abc import Iterable, Sequence
from contextlib import suppress
from time import monotonic
from typing import Any

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.arrays import Float32s, Floats, Ints
from core.descriptors.registry import ShapeDescriptors
from core.errors import BadRecordError, CoreError
from core.matching.match_records import match_record_of_points
from core.ranking.local_density import density_sample
from core.serialization import descriptors_from_bytes, points_from_bytes
from service.collection import DEFAULT_COLLECTION, CollectionNumber
from service.compute.request_queue import whole
from service.compute.tasks import example_records, warm_comparing
from service.container import Container
from service.errors import ServiceError
from service.index.cache import ABOUT, CollectionSample, EmbeddingCache
from service.index.repository import revision
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.signature_index import signature_index
from service.storage.database import ReadSession

log = get_logger("search")

KEPT_RECORDS = 512
"""Most embedding records that a query keeps, of 30 to 60 kB each."""

SECONDS, WARM_SECONDS = 0.5, 0.05
"""Seconds between looks for new shapes, and for a warm worker."""

FIRST_SECONDS = 1.0
"""The longest time that the service is not ready while it caches match records at its start."""

LEAST_SHARE = 4
"""Match records have at least this part (one in four) of the memory for searching."""

RECORDS_AT_ONCE = 16


class CandidateReader:
    """Reads stored embeddings for one query or one batch of the cache warmer; several threads may read.

    Deleted and unreadable embeddings are left out of every result.
    """

    def __init__(self, container: Container, active_pipeline: ActivePipeline) -> None:
        self._database = container.database
        self._descriptors = container.descriptors
        self._parameters = active_pipeline.pipeline.parameters
        self._match_records = active_pipeline.cache
        self._records: dict[int, bytes] = {}

    def records(self, numbers: Sequence[int]) -> dict[int, bytes]:
        """Return embedding records by number, from those that this reader has kept or from the database."""
        records = {number: self._records[number] for number in numbers if number in self._records}
        missing = [number for number in numbers if number not in records]
        if missing:
            with self._database.read() as session:
                read = repository.embedding_records(session, missing)
            records |= read
            if len(self._records) + len(read) <= KEPT_RECORDS:
                self._records |= read
        return records

    def match_records(
        self, numbers: Sequence[int], *, descriptors: bool = False
    ) -> tuple[dict[int, Float32s], dict[int, ShapeDescriptors]]:
        """Return match records by number, and with `descriptors` also these, from one read of the records."""
        match_records = self._match_records.get(numbers)
        described = self._descriptors.get(numbers) if descriptors else {}
        missing = [
            number
            for number in numbers
            if number not in match_records or (descriptors and number not in described)
        ]
        records = self.records(missing)
        for number in [number for number in records if number not in match_records]:
            with suppress(CoreError):
                points = points_from_bytes(records[number])
                match_records[number] = match_record_of_points(points, self._parameters)
                self._match_records.put(number, match_records[number])
        if descriptors:
            new = {number: record for number, record in records.items() if number not in described}
            described |= _described(self._descriptors, new)
        return match_records, described

    def descriptors(self, numbers: Sequence[int]) -> dict[int, ShapeDescriptors]:
        """Return descriptors by number."""
        described = self._descriptors.get(numbers)
        missing = [number for number in numbers if number not in described]
        return described | _described(self._descriptors, self.records(missing))


class BatchReader(CandidateReader):
    """Reads stored embeddings for the queries of a batch, which run side by side.

    `numbers` are the embeddings of the queries that are stored. `pairs` has CC, SSD and sim of those of their
    pairs that have been matched, the query first: they are the same whichever is the query.
    """

    def __init__(
        self, container: Container, active_pipeline: ActivePipeline, numbers: Iterable[int] = ()
    ) -> None:
        super().__init__(container, active_pipeline)
        self.numbers = frozenset(numbers)
        self.pairs: dict[tuple[int, int], Floats] = {}


def collection_sample(
    session: ReadSession, container: Container, active_pipeline: ActivePipeline, collection: CollectionNumber
) -> CollectionSample:
    """Return the sample of a collection, as the session sees it."""
    now = revision(session)
    kept = active_pipeline.samples.get([collection]).get(collection)
    if kept is not None and kept[0] == now:
        return kept[1]
    embeddings = signature_index(container, active_pipeline).sampled_embeddings(session, collection)
    if kept is not None and np.array_equal(kept[1].embeddings, embeddings):
        sample = kept[1]
    else:
        numbers = embeddings.tolist()
        described = container.descriptors.get(numbers)
        missing = [number for number in numbers if number not in described]
        records = repository.embedding_records(session, missing) if missing else {}
        described |= _described(container.descriptors, records)
        shapes = [described[number] for number in numbers if number in described]
        sample = CollectionSample(embeddings, density_sample(shapes))
    active_pipeline.samples.put(collection, (now, sample))
    return sample


def _described(
    cache: EmbeddingCache[ShapeDescriptors], records: dict[int, bytes]
) -> dict[int, ShapeDescriptors]:
    """Return the descriptors of records by number, and cache them."""
    described = {}
    for number, record in records.items():
        with suppress(BadRecordError):
            described[number] = descriptors_from_bytes(record)
            cache.put(number, described[number])
    return described


class CacheWarmer:
    """Fills the caches of the active pipeline, the newest embeddings first, one thread at a time.

    Embeddings beyond the room of a cache wait for a query that needs them, and the cache warmer waits for
    running queries.
    """

    def __init__(self, container: Container) -> None:
        self._container = container
        # Numbers are never used again.
        self._unusable: set[int] = set()
        self._seen: tuple[str, int] | None = None

    async def run(self) -> None:
        """Keep the caches filled until the task is cancelled, which ends after the batch at work."""
        try:
            await self._warm()
        except Exception:
            # The first queries load them.
            log.exception("the kernels of a search could not be loaded")
        ready, latest = self._container.comparing_is_ready, monotonic() + FIRST_SECONDS
        while True:
            # After any other error, queries are answered without a warm cache.
            try:
                active_pipeline, numbers = await whole(run_in_threadpool(self._missing))
                if not ready.is_set():
                    await whole(run_in_threadpool(self._read_sample, active_pipeline))
                for start in range(0, len(numbers), RECORDS_AT_ONCE):
                    await self._container.searches.until_idle()
                    batch = numbers[start : start + RECORDS_AT_ONCE]
                    await whole(run_in_threadpool(self._put_records, active_pipeline, batch))
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
                    reading = self._container.database.reading(self._container.pipelines.current)
                    active_pipeline = await whole(reading)
                    parameters = active_pipeline.pipeline.parameters
                    records = await self._container.queue.do(example_records, parameters)
                    await whole(run_in_threadpool(warm_comparing, records, parameters))
                    warm = True
            await asyncio.sleep(WARM_SECONDS)

    def _missing(self) -> tuple[ActivePipeline, list[int]]:
        """Return the embeddings that the cache of match records lacks and has room for."""
        settings, descriptors = self._container.settings, self._container.descriptors
        with self._container.database.read() as session:
            active_pipeline = self._container.pipelines.current(session)
            if not active_pipeline.pipeline.matcher.uses_match_records:
                return active_pipeline, []
            index = signature_index(self._container, active_pipeline)
            embeddings = index.newest(session, settings.search_bytes // ABOUT)
            seen = (active_pipeline.fingerprint, index.revision)
            if index.revision and seen != self._seen:
                for cache in (active_pipeline.cache, descriptors):
                    cache.keep(embeddings)
                self._seen = seen
        room = settings.search_bytes - index.nbytes - descriptors.nbytes
        active_pipeline.cache.resize(max(room, settings.search_bytes // LEAST_SHARE))
        return active_pipeline, self._wanted(active_pipeline.cache, embeddings)

    def _read_sample(self, active_pipeline: ActivePipeline) -> None:
        """Read the sample of the default collection: 512 records, a second of a cold disk."""
        with self._container.database.read() as session:
            collection_sample(session, self._container, active_pipeline, DEFAULT_COLLECTION.number)

    def _wanted(self, cache: EmbeddingCache[Any], embeddings: Ints) -> list[int]:
        """Return the embeddings that a cache lacks, the last ones first, as many as it has room for."""
        free = cache.free_count()
        if free <= 0 or len(cache) >= len(embeddings):
            return []
        newest = dict.fromkeys(embeddings[::-1].tolist())
        return [number for number in cache.missing(newest) if number not in self._unusable][:free]

    def _put_records(self, active_pipeline: ActivePipeline, numbers: list[int]) -> None:
        records, _ = CandidateReader(self._container, active_pipeline).match_records(numbers)
        self._unusable.update(number for number in numbers if number not in records)
