"""The addresses /query, /families, /map, and /similar and /suggestions of a shape."""

from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response, UploadFile
from pydantic import ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from service.collections.endpoints import InCollection, NamedInAddress
from service.container import Service
from service.http.middleware import while_connected
from service.http.problems import FILE_PROBLEMS, READ_PROBLEMS, WORKER_PROBLEMS, documented
from service.http.request_bodies import FORM, RequestBody, once_each
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.previews.endpoints import KNOWN, validated
from service.search.answer import SearchedFile, query_of_file, query_of_shape, search, with_active_pipeline
from service.search.batch import answer_files, answer_shapes
from service.search.families import families_of
from service.search.map import map_sheet, similarity_map_of
from service.search.schemas import BatchAnswer, FamiliesAnswer, MapAnswer, QueryAnswer, SearchOptions
from service.search.suggestion_schemas import LEAST_SHARE, Suggestions
from service.search.suggestions import suggestions_for
from service.shapes.endpoints import ENDINGS_IN_WORDS, MeshFile, MeshUpload, ShapeId
from service.shapes.fields import Id, Tags
from service.shapes.schemas import SHAPE, Filters
from service.turns import current_client

router = APIRouter(tags=["search"])

BATCH = 100
"""The most queries of a batch."""


class QueryParameters(NamedInAddress, SearchOptions):
    """Options of a search, as query parameters."""


class FileQuery(SearchOptions, MeshUpload):
    """A query with a mesh file."""


class StoredQuery(SearchOptions):
    """A query with a stored shape."""

    model_config = ConfigDict(json_schema_extra={"example": {"shape_id": SHAPE["id"], "top_k": 3}})

    shape_id: Id = Field(description="The id of the shape to search with.")


class FileBatch(SearchOptions):
    """Queries with mesh files, and the options of all of them."""

    file: list[MeshFile] = Field(
        min_length=1,
        max_length=BATCH,
        description="The meshes to search with: the field repeated. Together they may have the size of one "
        f"upload. {ENDINGS_IN_WORDS}",
    )


class StoredBatch(SearchOptions):
    """Queries with stored shapes, and the options of all of them."""

    model_config = ConfigDict(json_schema_extra={"example": {"shape_ids": [SHAPE["id"]], "top_k": 3}})

    tag: Tags = Field(default=[], description="Only shapes with all these tags.")
    shape_ids: list[Id] = Field(
        min_length=1, max_length=BATCH, description="The ids of the shapes to search with."
    )


QUERY = RequestBody[FileQuery | StoredQuery](FileQuery, json=StoredQuery)
QUERIES = RequestBody[FileBatch | StoredBatch](FileBatch, json=StoredBatch, most_files=BATCH)
WORK_PROBLEMS = (
    *("shape-not-found", "not-embedded", "cannot-be-embedded", "time-limit", "pipeline-unavailable"),
    "file-in-place",
    *READ_PROBLEMS,
    *WORKER_PROBLEMS,
)
ANSWER = "The most similar shapes, the best first, as `ranked_by` says."


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
    in_address = address.model_fields_set & SearchOptions.model_fields.keys() - body.model_fields_set
    options = body.model_copy(update={name: getattr(address, name) for name in in_address})
    shapes, timings, number = options.filtered(collection), Timings(), collection.number

    async def answer_one(active_pipeline: ActivePipeline) -> QueryAnswer:
        if isinstance(body, StoredQuery):
            exclude_self = options.exclude_self is not False
            about = container, number, body.shape_id, exclude_self, active_pipeline
            with timings.stage("read"):
                asked = await container.database.reading(query_of_shape, *about)
        else:
            exclude_self = bool(options.exclude_self)
            asked = await query_of_file(
                container, number, _searched(body.file), exclude_self, active_pipeline, timings
            )
        return await search(container, asked, options, shapes, timings)

    async with container.queue.admitted(request):
        answer = await while_connected(request, with_active_pipeline(container, answer_one))
    container.metrics.stages("query", timings.milliseconds)
    return answer


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
    return await query(request, container, collection, options, StoredQuery(shape_id=shape_id))


async def _sending(request: Request, container: Service) -> AsyncIterator[None]:
    """Wait until the client has sent few enough batches of files, and count this one until it is answered.

    Raise BusyError if none has been answered meanwhile.
    """
    if not request.headers.get("content-type", "").lower().startswith(FORM):
        yield
        return
    shares = container.file_batches
    busy = f"this client sends {shares.places} batches of files; try again when one is answered"
    async with shares.taken(current_client.get(), busy):
        yield


@router.post(
    "/query/batch",
    summary="Find shapes similar to each of several",
    response_description="The answers, in the order of the files or the ids.",
    responses=documented(*FILE_PROBLEMS, *WORK_PROBLEMS, "storage-full"),
    dependencies=[Depends(_sending, scope="function")],
    openapi_extra=QUERIES.openapi,
)
async def query_batch(
    request: Request,
    container: Service,
    collection: InCollection,
    batch: Annotated[FileBatch | StoredBatch, Depends(QUERIES, scope="function")],
) -> BatchAnswer:
    """Search with each of several mesh files or stored shapes, as `POST /query` does, in one request.

    The answers have no warnings about other orders and units. A file that cannot be used has its problem in
    the place of an answer. If there is no shape with one of the ids, the whole batch is refused.
    """
    about = batch, batch.filtered(collection)
    if isinstance(batch, FileBatch):
        files = [_searched(file) for file in batch.file]
        work = partial(answer_files, container, collection.number, files, *about)
    else:
        work = partial(answer_shapes, container, collection.number, batch.shape_ids, *about)
    async with container.queue.admitted(request):
        return await while_connected(request, with_active_pipeline(container, work))


def _searched(file: UploadFile) -> SearchedFile:
    async def read() -> bytes:
        # It is read again if the archive changes its pipeline meanwhile.
        await file.seek(0)
        return await file.read()

    return file.filename or "", read


class SuggestionsOptions(NamedInAddress):
    """The least share of a suggestion."""

    least_share: float = Field(
        default=LEAST_SHARE,
        gt=0.0,
        le=1.0,
        description="The least share of the neighbours, by their weights, that have a suggested value.",
    )


@router.get(
    "/shapes/{shape_id}/suggestions",
    summary="Suggest tags and metadata",
    responses=documented("shape-not-found", "pipeline-unavailable", *READ_PROBLEMS),
    dependencies=[once_each(SuggestionsOptions)],
)
def suggestions(
    shape_id: ShapeId,
    container: Service,
    collection: InCollection,
    options: Annotated[SuggestionsOptions, Query()],
) -> Suggestions:
    """Return tags and metadata that the neighbours of a shape have and the shape lacks.

    Neighbours are the stored shapes that are likely of one class with it. Nothing is changed: `PATCH` of the
    shape stores what a person accepts.
    """
    with container.database.read() as session:
        fingerprint = container.pipelines.current(session).fingerprint
        return suggestions_for(session, fingerprint, collection.number, shape_id, options.least_share)


class FamiliesOptions(NamedInAddress, Filters):
    """The shapes to show the families of, and how sure a link is."""

    least_probability: float = Field(
        default=0.9,
        gt=0.0,
        lt=1.0,
        description="The least class probability, as `combined` of a query has it, that joins two shapes.",
    )


@router.get(
    "/families",
    summary="Group shapes that are like each other",
    dependencies=[once_each(FamiliesOptions)],
    responses=documented("pipeline-unavailable", *READ_PROBLEMS),
)
def read_families(
    options: Annotated[FamiliesOptions, Query()], container: Service, collection: InCollection
) -> FamiliesAnswer:
    """Return groups of shapes that are probably of one class, such as the variants of a part.

    Two shapes are in one family if each is among the neighbours of the other and they have half of their
    neighbours in common, or if a chain of such pairs joins them.
    """
    wanted = options.filtered(collection)
    with container.database.read() as session:
        fingerprint = container.pipelines.current(session).fingerprint
        return families_of(session, fingerprint, wanted, options.least_probability)


MISSING = "Isoshape-Missing"
"""The header with the number of pictures that a sheet lacks."""


class MapOptions(NamedInAddress, Filters):
    """The shapes of a map."""


MAP_PROBLEMS = ("bad-request-fields", "busy", "shutting-down", "pipeline-unavailable", "storage-unavailable")


@router.get(
    "/map",
    summary="Lay shapes out by similarity",
    dependencies=[once_each(MapOptions)],
    responses=documented(*MAP_PROBLEMS),
)
async def read_map(
    options: Annotated[MapOptions, Query()], request: Request, container: Service, collection: InCollection
) -> MapAnswer:
    """Return positions of the stored shapes on a plane, where neighbours pull each other together.

    Similar shapes are near each other; shapes that are near each other may differ. While the neighbours of
    most shapes are unknown, the positions are the principal components of the signatures.
    """
    shape_filter = options.filtered(collection)

    async def lay_out(active_pipeline: ActivePipeline) -> MapAnswer:
        return await run_in_threadpool(similarity_map_of, container, shape_filter, active_pipeline)

    async with container.queue.admitted(request):
        return await while_connected(request, with_active_pipeline(container, lay_out))


@router.get(
    "/map/thumbnails.png",
    summary="Get the pictures of a map in one",
    response_class=Response,
    dependencies=[once_each(MapOptions)],
    responses={
        200: {
            "description": "A picture on a transparent background. Its ETag is the `version` of the map, a "
            "hyphen and the number of transparent cells.",
            "headers": {
                MISSING: {
                    "description": "The number of pictures that are drawn by further requests.",
                    "schema": {"type": "integer"},
                }
            },
            "content": {"image/png": {"schema": {"type": "string", "contentMediaType": "image/png"}}},
        },
        **KNOWN,
        **documented(*MAP_PROBLEMS),
    },
)
async def read_map_thumbnails(
    options: Annotated[MapOptions, Query()], request: Request, container: Service, collection: InCollection
) -> Response:
    """Return the thumbnails of the shapes of `GET /map` in one picture with `size` columns and rows.

    They stand row by row in the order of the list: the picture of the shape i is in the column i mod `size`
    and the row i / `size`. Pictures that nobody has asked for before are drawn, for about two seconds.
    """
    shape_filter = options.filtered(collection)
    known = (request.headers.get("If-None-Match") or "").strip().strip('"')
    async with container.queue.admitted(request):
        draw = partial(map_sheet, container, shape_filter, known)
        png, tag, missing = await while_connected(request, with_active_pipeline(container, draw))
    headers = {**validated(tag), MISSING: str(missing)}
    if png is None:
        return Response(status_code=304, headers=headers)
    return Response(png, media_type="image/png", headers=headers)
