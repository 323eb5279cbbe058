"""The addresses /query and /shapes/{shape_id}/similar."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request

from core.io import format_of
from service.collection import CollectionRecord
from service.collections.dependencies import InCollection
from service.container import Container
from service.dependencies import Service
from service.http.middleware import while_connected
from service.http.problems import FILE_PROBLEMS, documented
from service.http.request_bodies import RequestBody, once_each
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.search import partial_queries, records, service
from service.search.options import FileQuery, QueryParameters, StoredQuery, merged, search_options
from service.search.records import Answer
from service.search.schemas import QueryAnswer, QueryOptions
from service.search.unit_mistakes import with_unit_mistake
from service.shapes.endpoints import ShapeId

router = APIRouter(tags=["search"])

QUERY = RequestBody[FileQuery | StoredQuery](FileQuery, json=StoredQuery)
WORK_PROBLEMS = (
    "bad-request-fields",
    "shape-not-found",
    "not-embedded",
    "cannot-be-embedded",
    "busy",
    "shutting-down",
    "worker-lost",
    "cluster-unavailable",
    "time-limit",
    "file-time-limit",
    "pipeline-unavailable",
    "storage-unavailable",
)
ANSWER = "The most similar shapes, the best first: by cc, unless rank_by names another score."


@router.post(
    "/query",
    summary="Find similar shapes",
    response_description=ANSWER,
    responses=documented(*FILE_PROBLEMS, *WORK_PROBLEMS, "storage-full"),
    dependencies=[once_each(QueryParameters)],
    openapi_extra=QUERY.openapi,
)
async def query(
    request: Request,
    container: Service,
    collection: InCollection,
    address: Annotated[QueryParameters, Query()],
    body: Annotated[FileQuery | StoredQuery, Depends(QUERY, scope="function")],
) -> QueryAnswer:
    """Search with a mesh file, or with a stored shape by its id. Rotation and pose make no difference.

    Options are fields of the form or of the JSON object, or query parameters; the body overrides the query
    parameters. A JSON object asks the same as `GET /shapes/{shape_id}/similar`.
    """
    options = merged(body, address)
    if isinstance(body, StoredQuery):
        return await _similar_to_stored(request, container, collection, body.shape_id, options)
    mesh_format = format_of(body.file.filename or "")
    how = search_options(options, collection.number, container.settings, exclude_self=False)
    with container.queue.admitted():
        data = await body.file.read()

        async def embedded(active_pipeline: ActivePipeline, timings: Timings) -> records.Query:
            return await service.by_file(
                container, collection.number, data, mesh_format, active_pipeline, timings
            )

        return await _similar(request, container, embedded, how, partial=options.partial)


@router.get(
    "/shapes/{shape_id}/similar",
    summary="Find shapes similar to a stored one",
    response_description=ANSWER,
    responses=documented(*WORK_PROBLEMS),
    dependencies=[once_each(QueryParameters)],
)
async def similar(
    shape_id: ShapeId,
    request: Request,
    container: Service,
    collection: InCollection,
    options: Annotated[QueryParameters, Query()],
) -> QueryAnswer:
    """Search with a stored shape: the same as `POST /query` with the shape's id and these options."""
    return await _similar_to_stored(request, container, collection, shape_id, options)


async def _similar_to_stored(
    request: Request, container: Container, collection: CollectionRecord, shape_id: str, options: QueryOptions
) -> QueryAnswer:
    own = collection.number
    how = search_options(options, own, container.settings, exclude_self=True)

    async def embedded(active_pipeline: ActivePipeline, timings: Timings) -> records.Query:
        return await service.by_id(container, own, shape_id, active_pipeline, timings)

    with container.queue.admitted():
        return await _similar(request, container, embedded, how, partial=options.partial)


async def _similar(
    request: Request,
    container: Container,
    embedded: Callable[[ActivePipeline, Timings], Awaitable[records.Query]],
    options: records.Options,
    *,
    partial: bool,
) -> QueryAnswer:
    """The answer to a query, whose embedding `embedded` gives; `partial` tells whether it is a part."""
    timings = Timings()

    async def found(active_pipeline: ActivePipeline) -> Answer:
        wanted = await embedded(active_pipeline, timings)
        search = partial_queries.search if partial else service.search
        answer = await search(container, wanted, options, timings)
        return await with_unit_mistake(container, wanted, options, answer, timings)

    answer = await while_connected(request, service.in_one_pipeline(container, found))
    container.metrics.stages("query", timings.milliseconds)
    return QueryAnswer.of(answer, milliseconds=timings.so_far())
