"""Near-identical shapes: all shapes are judged, and the pairs that the database keeps are reported.

Shapes are judged in the background while the service is idle, or within a request.
"""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from time import monotonic

import numpy as np

from service.collection import CollectionNumber
from service.compute.request_queue import together
from service.container import Container
from service.duplicates import decision_repository, repository
from service.duplicates.groups import Counted, Groups, Search, undecided
from service.duplicates.judging import ShapeJudge
from service.duplicates.records import pair_of
from service.duplicates.schemas import Duplicate, DuplicatesAnswer
from service.errors import ServiceError, StorageFullError, StorageUnavailableError
from service.index import neighbour_repository
from service.index.repository import revision
from service.observability.logging import get_logger
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline, Pipelines
from service.search.neighbours import likeliest
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from service.shapes.schemas import Shape
from service.storage.database import ReadSession

JUDGING_SECONDS = 5.0
"""The time after which a request begins to judge no further shape."""

RECORDS_AT_ONCE = 1_000
"""Shapes whose records one statement reads."""

LOOK_SECONDS, BUSY_SECONDS, TRY_AGAIN_SECONDS = 2.0, 0.25, 60.0
"""Seconds between looks for new shapes, between looks at a busy service, and after an error."""

JUDGED_AT_ONCE, LOOKED_AT_ONCE = 256, 64
"""Shapes to judge that one statement reads for a request; and to judge, or to find neighbours of, in the
background, which then looks for new shapes."""

log = get_logger("duplicates")


async def find(
    container: Container,
    shapes: ShapeFilter,
    bounds: Search,
    counted: Counted,
    active_pipeline: ActivePipeline,
    timings: Timings,
    *,
    seconds: float | None = None,
    limit: int | None = None,
    with_paths: bool = False,
) -> DuplicatesAnswer:
    """Find the groups of near-identical shapes, the first `limit` or all, perhaps with paths in sources.

    Shapes that are not judged yet are judged first, for about `seconds`, by default `JUDGING_SECONDS`, where
    the archive can be written to. The kept pairs within the bounds join the shapes of the whole collection;
    the filter, sizes and hands that count choose among the members of the groups. Shapes all of whose pairs
    in their group are decided are left out unless these count, and a pair that is decided to differ joins no
    group.
    """
    kinds = (False, True) if bounds.variants else (False,)
    searches = [Search(bounds.fingerprint, variants) for variants in kinds]
    with timings.stage("judge"):
        end = monotonic() + (JUDGING_SECONDS if seconds is None else seconds)
        try:
            for search in () if seconds == 0.0 else searches:
                await judge_for(container, active_pipeline, search, shapes.collection, end)
        except (StorageFullError, StorageUnavailableError) as error:
            log.warning("the shapes are judged later: %s", error)

    with timings.stage("results"):
        answer = await container.database.reading(
            _report, searches, shapes, bounds, counted, limit=limit, with_paths=with_paths
        )
    return answer.model_copy(update={"milliseconds": timings.so_far()})


def _report(
    session: ReadSession,
    searches: Sequence[Search],
    wanted: ShapeFilter,
    bounds: Search,
    counted: Counted,
    *,
    limit: int | None,
    with_paths: bool,
) -> DuplicatesAnswer:
    collection = wanted.collection
    shapes = repository.embedded(session, bounds.fingerprint, wanted)
    links = repository.links_of(session, collection, bounds)
    decided = decision_repository.decided(session, collection)
    linked = {shape for link in links for shape in (link.first, link.second)}
    files = decision_repository.hashes(session, linked) if decided else {}
    groups = Groups()
    for link in links:
        decision = decided.get(pair_of(files[link.first], files[link.second])) if decided else None
        if counted.decided or decision != "different":
            groups.join(link)
    members = groups.members(shapes, counted)
    if decided and not counted.decided:
        left = undecided([[member.shape for member in group] for group in members], files, decided)
        members = groups.members(left, counted)
    total = len(members)
    members = members[:limit]
    shown = [member for group in members for member in group]
    compared_with = {member.compared_with for member in shown if member.compared_with is not None}
    numbers = sorted({member.shape for member in shown} | compared_with)
    parts = [numbers[start : start + RECORDS_AT_ONCE] for start in range(0, len(numbers), RECORDS_AT_ONCE)]
    records = {
        record.number: record
        for part in parts
        for record in shapes_repository.records(session, collection, part)
    }
    paths: dict[int, list[str]] = {}
    for part in parts if with_paths else ():
        paths |= repository.paths_of(session, collection, part)
    compared, aligned = np.sum([repository.counts(session, each, shapes) for each in searches], axis=0)
    return DuplicatesAnswer(
        groups=[
            [
                Duplicate(
                    shape=Shape.of(records[member.shape]),
                    likeness=member.likeness,
                    scale=member.scale,
                    cc=member.cc,
                    residual=member.residual,
                    difference=member.difference,
                    decision=decided.get(pair_of(files[group[0].shape], files[member.shape]))
                    if decided and member is not group[0]
                    else None,
                    compared_with=records[member.compared_with].id if member.compared_with else None,
                    paths=paths.get(member.shape, []),
                )
                for member in group
            ]
            for group in members
        ],
        total=total,
        shapes=len(shapes),
        compared=int(compared),
        aligned=int(aligned),
        unjudged=max(repository.count_unjudged(session, each, collection) for each in searches),
        milliseconds={},
    )


async def keep_judging(container: Container) -> None:
    """Find the neighbours of new shapes; judge them for copies, then for variants once these were asked for.

    This happens while no request and no job is at work, for as many shapes at a time as there are workers.
    The database knows what is done, so that a restarted service continues.
    """

    async def idle() -> bool:
        await _idle(container)
        return True

    while not container.comparing_is_ready.is_set():
        await asyncio.sleep(BUSY_SECONDS)
    reading, pipelines = container.database.reading, container.pipelines
    finished = None
    while True:
        try:
            state = await reading(_wanted, pipelines)
            if state != finished:
                _, active_pipeline, searches = state
                while await find_neighbours(container, active_pipeline):
                    if await reading(_wanted, pipelines) != state:
                        break
                for search in searches:
                    while await _judge_some(
                        container, active_pipeline, search, None, idle, container.settings.workers
                    ):
                        if await reading(_wanted, pipelines) != state:
                            break
                finished = state
        except ServiceError as error:
            log.warning("the search for near shapes failed and continues later: %s", error)
            await asyncio.sleep(TRY_AGAIN_SECONDS)
        except Exception:
            log.exception("the search for near shapes failed and continues later")
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

    If all are being judged, wait for one of them. A shape cannot be judged while the index does not have it.
    `wanted` is awaited before each shape and says whether to go on.
    """

    async def look() -> list[tuple[CollectionNumber, int]]:
        reading = container.database.reading
        limit = LOOKED_AT_ONCE if collection is None else JUDGED_AT_ONCE
        return await reading(repository.unjudged, search, collection=collection, limit=limit)

    unjudged = await look()
    keys = {(shape, search.variants) for _, shape in unjudged}
    waiting = iter(unjudged)
    taken = False

    async def take() -> None:
        nonlocal taken
        for of, shape in waiting:
            key = shape, search.variants
            if key in container.judging:
                continue
            if not await wanted():
                return
            if key in container.judging:
                continue
            taken = True
            container.judging.add(key)
            try:
                await ShapeJudge(container, active_pipeline, search, of, shape).judge()
            finally:
                container.judging.discard(key)

    await together(take() for _ in range(at_a_time))
    if not taken and keys & container.judging:
        while keys <= container.judging:
            await asyncio.sleep(BUSY_SECONDS)
        return True
    return bool(unjudged) and await look() != unjudged


async def find_neighbours(container: Container, active_pipeline: ActivePipeline) -> bool:
    """Find the neighbours of the oldest shapes whose are unknown; False if there are none.

    A pipeline without match records compares too slowly: it has no graph of neighbours.
    """
    if not active_pipeline.pipeline.matcher.uses_match_records:
        return False
    reading, fingerprint = container.database.reading, active_pipeline.fingerprint
    shapes = await reading(neighbour_repository.lacking, fingerprint, LOOKED_AT_ONCE)
    workers = container.settings.workers
    for start in range(0, len(shapes), workers):
        await _idle(container)
        # The rows are stored in the order of the shapes, whichever are compared first.
        compared = await together(
            likeliest(container, active_pipeline, *shape) for shape in shapes[start : start + workers]
        )
        await container.database.writing(neighbour_repository.write, fingerprint, compared)
    return bool(shapes)


async def _idle(container: Container) -> None:
    """Wait until no request and no job uses the workers, judgements aside."""
    while True:
        await container.searches.until_idle()
        busy = container.pool.counts().busy + container.readers.counts().busy
        if not container.queue.inside and busy <= len(container.judging):
            return
        await asyncio.sleep(BUSY_SECONDS)


def _wanted(session: ReadSession, pipelines: Pipelines) -> tuple[int, ActivePipeline, list[Search]]:
    """Return the revision of the archive, its active pipeline, and the searches that are wanted."""
    active_pipeline = pipelines.current(session)
    copies, variants = (Search(active_pipeline.fingerprint, variants) for variants in (False, True))
    searches = [copies, variants] if repository.has_begun(session, variants) else [copies]
    return revision(session), active_pipeline, searches
