"""The addresses /query, /shapes/{shape_id}/similar and /compare."""

from collections.abc import Awaitable, Callable
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Query, Request, Response

from core.io import format_of
from service.collection import CollectionRecord
from service.collections.dependencies import InCollection
from service.container import Container
from service.dependencies import Service
from service.http.disconnects import while_connected
from service.http.duplicate_parameters import once, once_each
from service.http.problems import documented
from service.http.request_bodies import RequestBody
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.rendering.glb import MEDIA_TYPE
from service.search import partial_queries, records, service
from service.search.comparison_preview import coloured
from service.search.options import FileQuery, QueryParameters, StoredQuery, merged, search_options
from service.search.records import Answer, Comparison, Relation
from service.search.schemas import CompareAnswer, CompareRequest, QueryAnswer, QueryOptions
from service.shapes.documentation import FILE_PROBLEMS
from service.shapes.endpoints import ShapeId
from service.web.answers import comparing_page

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
    with container.work.admitted():
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


@router.post(
    "/compare",
    summary="Compare two stored shapes",
    response_model=CompareAnswer,
    dependencies=[once("format")],
    responses={
        200: {
            "description": "The scores and the corresponding points; or a GLB with both meshes; or a page "
            "with them.",
            "content": {
                MEDIA_TYPE: {"schema": {"type": "string", "contentMediaType": MEDIA_TYPE}},
                "text/html": {"schema": {"type": "string"}},
            },
        },
        **documented(
            "bad-request",
            "bad-request-fields",
            "body-too-large",
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
        ),
    },
)
async def compare(
    pair: CompareRequest,
    request: Request,
    container: Service,
    collection: InCollection,
    format: Annotated[
        Literal["json", "glb", "html"],
        Query(
            description="glb: both meshes side by side, with corresponding points in equal colours. html: a "
            "page with the two shapes, for a browser that may read them from this service."
        ),
    ] = "json",
) -> CompareAnswer | Response:
    """The scores of two stored shapes, and their corresponding points."""
    timings, own = Timings(), collection.number

    async def compared(active_pipeline: ActivePipeline) -> tuple[Comparison, Relation, bytes]:
        found, relation = await service.compare(
            container, own, pair.first, pair.second, active_pipeline, timings
        )
        if format != "glb":
            return found, relation, b""
        with timings.stage("draw"):
            return found, relation, await coloured(container, own, pair.first, pair.second, found)

    with container.work.admitted():
        comparison, relation, glb = await while_connected(
            request, service.in_one_pipeline(container, compared)
        )
    container.metrics.stages("compare", timings.milliseconds)
    if format == "glb":
        return Response(glb, media_type=MEDIA_TYPE)
    if format == "html":
        return comparing_page(pair.first, pair.second, collection.name)
    return CompareAnswer.of(comparison, relation, milliseconds=timings.so_far())


async def _similar_to_stored(
    request: Request, container: Container, collection: CollectionRecord, shape_id: str, options: QueryOptions
) -> QueryAnswer:
    own = collection.number
    how = search_options(options, own, container.settings, exclude_self=True)

    async def embedded(active_pipeline: ActivePipeline, timings: Timings) -> records.Query:
        return await service.by_id(container, own, shape_id, active_pipeline, timings)

    with container.work.admitted():
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
        return await search(container, wanted, options, timings)

    answer = await while_connected(request, service.in_one_pipeline(container, found))
    container.metrics.stages("query", timings.milliseconds)
    return QueryAnswer.of(answer, milliseconds=timings.so_far())
