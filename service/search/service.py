"""The search for the most similar stored shapes, and the comparison of two."""

from collections.abc import Awaitable, Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.embedding import Scores
from core.serialization import embedding_from_bytes
from service.collection import CollectionNumber
from service.compute.request_queue import Work
from service.container import Container
from service.errors import NotEmbeddedError
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.class_probability import class_probabilities
from service.search.ranking import Compared, ranked
from service.search.records import Answer, Comparison, Options, Query, SearchResult
from service.search.scoring import compare_with
from service.search.shortlist import Candidates, candidates
from service.shapes import repository as shapes_repository
from service.shapes import service as shapes_service
from service.shapes.records import ShapeRecord, sha256

Done = TypeVar("Done")


async def in_one_pipeline(container: Container, work: Callable[[ActivePipeline], Awaitable[Done]]) -> Done:
    """The result of work with the active pipeline, done again if the archive changed its pipeline meanwhile.

    The embeddings that the work began with may have been deleted.
    """

    def current() -> ActivePipeline:
        with container.database.read() as session:
            return container.pipelines.current(session)

    active_pipeline = await run_in_threadpool(current)
    while True:
        try:
            done = await work(active_pipeline)
        except NotEmbeddedError:
            before, active_pipeline = active_pipeline, await run_in_threadpool(current)
            if active_pipeline is before:
                raise
        else:
            before, active_pipeline = active_pipeline, await run_in_threadpool(current)
            if active_pipeline is before:
                return done


async def by_file(
    container: Container,
    collection: CollectionNumber,
    data: bytes,
    format: str,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> Query:
    """The query by a file; the shapes of the collection with the same bytes are the query itself."""
    embedded = await container.work.embed(data, format, active_pipeline.pipeline)
    timings.milliseconds |= embedded.milliseconds

    def itself() -> frozenset[int]:
        with container.database.read() as session:
            return frozenset(repository.numbers_of_bytes(session, collection, sha256(data)))

    return Query(active_pipeline, embedded.record, await run_in_threadpool(itself))


async def by_id(
    container: Container,
    collection: CollectionNumber,
    shape_id: str,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> Query:
    """The query by a stored shape of a collection."""
    fingerprint = active_pipeline.fingerprint

    def read() -> Query:
        with container.database.read() as session:
            number = shapes_service.get(session, fingerprint, collection, shape_id).number
            record = shapes_service.get_record(session, fingerprint, collection, shape_id)
            return Query(active_pipeline, record, frozenset([number]))

    with timings.stage("read"):
        return await run_in_threadpool(read)


async def search(container: Container, query: Query, options: Options, timings: Timings) -> Answer:
    """The stored shapes most like the query."""
    with timings.stage("shortlist"):
        chosen = await run_in_threadpool(candidates, container, query, options)
    container.metrics.query_compared.observe(len(chosen.shapes))
    with timings.stage("compare"):
        compared, scored = await compare_with(container, query, chosen, options.rank_by)
    with timings.stage("results"):
        best = ranked(compared, options.rank_by)
        best = best[compared.cc[best] >= options.min_cc][: options.top_k]
        found = await results(container, query, compared, scored, best, options)
    return Answer(
        pipeline=query.active_pipeline.pipeline,
        found=found,
        best_cc=float(compared.cc.max()) if len(compared.cc) else None,
        compared=len(compared.shapes),
        stored=chosen.stored,
        boundary_ratio=query.embedding.facts.openness,
        embedding=query.embedding if options.embedding else None,
    )


async def compare(
    container: Container,
    collection: CollectionNumber,
    first_id: str,
    second_id: str,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> Comparison:
    """Two shapes of a collection compared."""
    fingerprint = active_pipeline.fingerprint

    def read() -> tuple[bytes, bytes]:
        with container.database.read() as session:
            return (
                shapes_service.get_record(session, fingerprint, collection, first_id),
                shapes_service.get_record(session, fingerprint, collection, second_id),
            )

    with timings.stage("read"):
        first, second = await run_in_threadpool(read)
    with timings.stage("compare"):
        return await _compared(container.work, Query(active_pipeline, first, frozenset()), second)


async def results(
    container: Container,
    query: Query,
    compared: Compared,
    scored: Candidates,
    best: NDArray[np.intp],
    options: Options,
) -> list[SearchResult]:
    """The best shapes as they are shown, without one that was deleted a moment ago.

    `scored` are the shapes of `compared`; `best` are places in both.
    """
    pipeline = query.active_pipeline.pipeline
    fingerprint, collection = pipeline.fingerprint, options.filter.collection

    def read() -> list[tuple[ShapeRecord, bytes | None]]:
        with container.database.read() as session:
            numbers = compared.shapes[best].tolist()
            shapes = shapes_repository.records(session, fingerprint, collection, numbers)
            if not options.correspondences:
                return [(shape, None) for shape in shapes]
            return [
                (shape, shapes_repository.embedding_of(session, fingerprint, collection, shape.id))
                for shape in shapes
            ]

    combined = await class_probabilities(
        container, query, scored.only(best), compared.cc[best], compared.sim[best]
    )
    probability_of = dict(zip(best.tolist(), combined.tolist(), strict=True))
    places = {int(compared.shapes[place]): int(place) for place in best}
    found = []
    for shape, record in await run_in_threadpool(read):
        place = places[shape.number]
        found.append(
            SearchResult(
                shape=shape,
                cc=float(compared.cc[place]),
                ssd=float(compared.ssd[place]),
                sim=float(compared.sim[place]),
                combined=probability_of[place],
                comparison=None if record is None else await _compared(container.work, query, record),
            )
        )
    return found


async def _compared(work: Work, query: Query, record: bytes) -> Comparison:
    """The query and the embedding of a record, matched."""
    pipeline = query.active_pipeline.pipeline
    match = await work.match(query.record, record, pipeline)
    embedding = embedding_from_bytes(record)
    scores = Scores(*(np.array([score]) for score in (match.cc, match.ssd, match.sim)))
    combined = pipeline.combined_with(query.embedding, [embedding], scores)
    return Comparison(pipeline, query.embedding, embedding, match, combined=float(combined[0]))
