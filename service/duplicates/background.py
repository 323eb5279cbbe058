"""The judgement of all shapes: in the background while the service is idle, or within a request."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from time import monotonic

from starlette.concurrency import run_in_threadpool

from service.collection import CollectionNumber
from service.container import Container
from service.duplicates import repository
from service.duplicates.judgements import Search
from service.duplicates.judging import ShapeJudge
from service.errors import ServiceError
from service.index.repository import revision
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline

log = get_logger("duplicates")

LOOK_SECONDS, BUSY_SECONDS, TRY_AGAIN_SECONDS = 2.0, 0.25, 60.0
"""Seconds between looks for new shapes, between looks at a busy service, and after an error."""

AT_ONCE = 64
"""Shapes that are read from the database at a time."""


async def keep_judging(container: Container) -> None:
    """Judge new shapes for copies, and then for variants once these were asked for.

    Shapes are judged while no request and no job is at work, only as many at a time as there are workers. The
    database knows which are judged, so that a restarted service continues.
    """

    async def idle() -> bool:
        await _idle(container)
        return True

    while not container.comparing_is_ready.is_set():
        await asyncio.sleep(BUSY_SECONDS)
    finished: _State | None = None
    while True:
        try:
            state = await run_in_threadpool(_state, container)
            if state != finished:
                for search in state.searches:
                    while await _judge_some(
                        container, state.active_pipeline, search, None, idle, container.settings.workers
                    ):
                        if await run_in_threadpool(_state, container) != state:
                            break
                finished = state
        except ServiceError as error:
            log.warning("the search for near-identical shapes failed and continues later: %s", error)
            await asyncio.sleep(TRY_AGAIN_SECONDS)
        except Exception:
            log.exception("the search for near-identical shapes failed and continues later")
            await asyncio.sleep(TRY_AGAIN_SECONDS)
        await asyncio.sleep(LOOK_SECONDS)


async def judge_for(
    container: Container,
    active_pipeline: ActivePipeline,
    search: Search,
    collection: CollectionNumber,
    end: float,
) -> None:
    """Judge the shapes of a collection, at least one, until a time of `time.monotonic`."""
    first = iter([True])

    async def in_time() -> bool:
        return next(first, False) or monotonic() < end

    # While one shape is read or stored, another one is registered.
    at_a_time = 2 * container.settings.workers
    while (
        await _judge_some(container, active_pipeline, search, collection, in_time, at_a_time)
        and monotonic() < end
    ):
        pass


async def _judge_some(
    container: Container,
    active_pipeline: ActivePipeline,
    search: Search,
    collection: CollectionNumber | None,
    wanted: Callable[[], Awaitable[bool]],
    at_a_time: int,
) -> bool:
    """Judge the oldest shapes that are neither judged nor being judged; False if none of them can be judged.

    A shape cannot be judged while the index does not have it. `wanted` is awaited before each shape and says
    whether to go on.
    """

    def look() -> list[tuple[CollectionNumber, int]]:
        with container.database.read() as session:
            return repository.unjudged(session, search, collection=collection, limit=AT_ONCE)

    found = await run_in_threadpool(look)
    waiting = iter(found)

    async def take() -> None:
        for of, shape in waiting:
            if not await wanted():
                return
            key = shape, search.variants
            if key not in container.judging:
                container.judging.add(key)
                try:
                    await ShapeJudge(container, active_pipeline, search, of, shape).judge()
                finally:
                    container.judging.discard(key)

    elsewhere = [shape for _, shape in found if (shape, search.variants) in container.judging]
    if found and len(elsewhere) == len(found):
        await asyncio.sleep(BUSY_SECONDS)
    try:
        async with asyncio.TaskGroup() as group:
            for _ in range(at_a_time):
                group.create_task(take())
    except ExceptionGroup as several:
        raise several.exceptions[0] from None
    return bool(elsewhere) or (bool(found) and await run_in_threadpool(look) != found)


async def _idle(container: Container) -> None:
    """Wait until no request and no job uses the workers, judgements aside."""
    while True:
        await container.searches.until_idle()
        busy = container.pool.busy() + container.readers.busy()
        if not container.queue.inside and busy <= len(container.judging):
            return
        await asyncio.sleep(BUSY_SECONDS)


@dataclass(frozen=True)
class _State:
    """The searches that are wanted, of the archive at one revision."""

    revision: int
    active_pipeline: ActivePipeline
    searches: tuple[Search, ...]


def _state(container: Container) -> _State:
    with container.database.read() as session:
        active_pipeline = container.pipelines.current(session)
        copies, variants = (Search(active_pipeline.fingerprint, variants) for variants in (False, True))
        searches = (copies, variants) if repository.has_begun(session, variants) else (copies,)
        return _State(revision(session), active_pipeline, searches)
