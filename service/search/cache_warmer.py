"""Embeddings made ready to be compared before a query asks for them: at the start, and as shapes come."""

import asyncio
from collections.abc import Awaitable
from contextlib import suppress
from time import monotonic
from typing import TypeVar

from starlette.concurrency import run_in_threadpool

from service.compute.tasks import example_records, warm_comparing
from service.compute.workers import PlacedWorkers
from service.container import Parts
from service.errors import ServiceError
from service.index.cache import ABOUT
from service.observability.logging import get_logger
from service.pipelines.active import InUse
from service.search.match_records import shelved
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


class Stocking:
    """Fills the room of the shelf in use, the newest embeddings first, one thread at a time.

    What has no room waits for a query that needs it, and this for queries that are at work. Where workers
    keep embeddings of their own, nothing is made ready here.
    """

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
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
        ready, latest = self._parts.comparing_is_ready, monotonic() + FIRST_SECONDS
        while True:
            # Whatever else goes wrong, queries are answered without what would be ready.
            try:
                in_use, missing = await _whole(run_in_threadpool(self._missing))
                for start in range(0, len(missing), AT_ONCE):
                    await self._parts.searches.nothing()
                    await _whole(run_in_threadpool(self._put, in_use, missing[start : start + AT_ONCE]))
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
            if self._parts.pool.pids():
                # A lost worker, and storage that is away, are told of to those who ask.
                with suppress(ServiceError):
                    parameters = (await _whole(run_in_threadpool(self._in_use))).pipeline.parameters
                    records = await self._parts.work.do(example_records, parameters)
                    await _whole(run_in_threadpool(warm_comparing, records, parameters))
                    warm = True
            await asyncio.sleep(WARM_SECONDS)

    def _in_use(self) -> InUse:
        with self._parts.database.read() as session:
            return self._parts.pipelines.current(session)

    def _missing(self) -> tuple[InUse, list[int]]:
        """The numbers of embeddings that are not on the shelf and for which there is room."""
        with self._parts.database.read() as session:
            in_use = self._parts.pipelines.current(session)
            if in_use.pipeline.parameters.pairs != "both-ways" or isinstance(self._parts.pool, PlacedWorkers):
                return in_use, []
            most = self._parts.settings.search_bytes
            if self._parts.settings.signatures == "database":
                newest, room = latest(session, in_use.fingerprint, most // ABOUT), most
            else:
                signed = in_use.index.current(session)
                seen = (in_use.fingerprint, in_use.index.revision)
                if seen != self._seen:
                    in_use.shelf.keep(signed.embeddings)
                    self._parts.patches.keep(signed.embeddings)
                    self._seen = seen
                newest = signed.embeddings[::-1].tolist()
                room = most - signed.nbytes
        shelf = in_use.shelf
        shelf.resize(max(room - self._parts.patches.nbytes, most // LEAST_SHARE))
        places = shelf.free_places()
        if not places or len(shelf) >= len(newest):
            return in_use, []
        wanted = shelf.missing(dict.fromkeys(newest))
        return in_use, [number for number in wanted if number not in self._unusable][:places]

    def _put(self, in_use: InUse, numbers: list[int]) -> None:
        rows = shelved(self._parts.database, in_use.shelf, in_use.pipeline.parameters, numbers)
        self._unusable.update(number for number in numbers if number not in rows)


async def _whole(work: Awaitable[Done]) -> Done:
    """What a thread does, waited for even when this is cancelled: it may be reading the database."""
    begun = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(begun)
    except asyncio.CancelledError:
        await asyncio.wait([begun])
        raise
