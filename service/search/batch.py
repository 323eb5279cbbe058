"""Many queries in one request. They share one reader, and run side by side in few long parts each."""

import asyncio
from collections.abc import Iterable, Sequence

from core.errors import MeshError
from service.collection import CollectionNumber
from service.compute.request_queue import together
from service.container import Container
from service.errors import FileTimeLimitError, WorkerCrashedError
from service.http.problem_document import Cause
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.search.answer import SearchedFile, query_of_file, query_of_shape, search
from service.search.caches import BatchReader
from service.search.records import Query
from service.search.schemas import BatchAnswer, QueryAnswer, SearchOptions
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

AHEAD = 1
"""Queries of a batch that are read and answered while each worker compares one."""


async def answer_files(
    container: Container,
    collection: CollectionNumber,
    files: Iterable[SearchedFile],
    options: SearchOptions,
    shapes: ShapeFilter,
    active_pipeline: ActivePipeline,
) -> BatchAnswer:
    """Search with each of several files; one that cannot be used has its problem in place of an answer."""
    reader, turns = BatchReader(container, active_pipeline), _turns(container)
    exclude_self = bool(options.exclude_self)

    async def answer(file: SearchedFile) -> QueryAnswer | Cause:
        async with turns:
            try:
                query = await query_of_file(
                    container, collection, file, exclude_self, active_pipeline, Timings()
                )
                return await search(container, query, options, shapes, Timings(), advise=False, batch=reader)
            except (MeshError, FileTimeLimitError, WorkerCrashedError) as error:
                return Cause.of(error.kind, str(error))

    return BatchAnswer(answers=await together(answer(file) for file in files))


async def answer_shapes(
    container: Container,
    collection: CollectionNumber,
    shape_ids: Sequence[str],
    options: SearchOptions,
    shapes: ShapeFilter,
    active_pipeline: ActivePipeline,
) -> BatchAnswer:
    """Search with each of several stored shapes, which are read together.

    Raises
    ------
    ShapeNotFoundError, NotEmbeddedError
        The collection lacks one of the shapes, or its embedding.
    """
    exclude_self, turns = options.exclude_self is not False, _turns(container)

    def read(session: ReadSession) -> list[Query]:
        return [
            query_of_shape(session, container, collection, shape_id, exclude_self, active_pipeline)
            for shape_id in shape_ids
        ]

    queries = await container.database.reading(read)
    numbers = [query.number for query in queries if query.number is not None]
    reader = BatchReader(container, active_pipeline, numbers)

    async def answer(query: Query) -> QueryAnswer:
        async with turns:
            return await search(container, query, options, shapes, Timings(), advise=False, batch=reader)

    answers = [answer(query) for query in queries]
    # A query goes once it is answered, with the mesh that it may have read.
    del queries
    return BatchAnswer(answers=list(await together(answers)))


def _turns(container: Container) -> asyncio.Semaphore:
    return asyncio.Semaphore(container.settings.workers + AHEAD)
