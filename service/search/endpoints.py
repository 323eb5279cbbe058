"""The addresses /query and /compare."""

from dataclasses import replace
from typing import Annotated, Any, Literal, TypeVar

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ValidationError

from core.io import format_of
from service.collection import CollectionNumber
from service.collections.dependencies import PARAMETER, InCollection
from service.container import Container
from service.dependencies import Service
from service.errors import BadRequestFieldsError, FieldFault, UnsupportedBodyError
from service.http.disconnects import while_connected
from service.http.problem_document import faults_of
from service.http.problems import documented
from service.http.uploads import is_form, is_json, single, uploaded
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.rendering.glb import MEDIA_TYPE
from service.search import partial_queries as partial
from service.search import service
from service.search.comparison_preview import coloured
from service.search.records import Answer, Comparison, Options
from service.search.schemas import (
    SAME_SIZE,
    CompareAnswer,
    CompareRequest,
    QueryAnswer,
    QueryOptions,
    StoredQuery,
)
from service.shapes.documentation import FILE_FIELD, FILE_PROBLEMS
from service.web.answers import comparing_page

router = APIRouter(tags=["search"])

Model = TypeVar("Model", bound=BaseModel)

REPEATED = frozenset({"exclude", "filter", "metadata", "tag"})


def _as_text(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema of an option in an address or a form, where nothing is null: it is left out instead."""
    choices = [choice for choice in schema.get("anyOf", []) if choice != {"type": "null"}]
    if len(choices) != 1:
        return schema
    kept = {key: value for key, value in schema.items() if key not in {"anyOf", "default"}}
    return {**kept, **choices[0]}


_OPTIONS = {name: _as_text(schema) for name, schema in QueryOptions.model_json_schema()["properties"].items()}

QUERY_BODY: dict[str, Any] = {
    "parameters": [
        {
            "name": name,
            "in": "query",
            "required": False,
            "description": schema["description"],
            "schema": {key: value for key, value in schema.items() if key != "description"},
        }
        for name, schema in _OPTIONS.items()
    ],
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {"file": FILE_FIELD, **_OPTIONS},
                    "additionalProperties": False,
                }
            },
            "application/json": {"schema": StoredQuery.model_json_schema()},
        },
    },
}


@router.post(
    "/query",
    summary="Find the shapes most like one",
    response_description="The most alike, first of all by cc.",
    responses=documented(
        *FILE_PROBLEMS,
        "shape-not-found",
        "not-embedded",
        "time-limit",
        "pipeline-unavailable",
        "storage-unavailable",
        "storage-full",
    ),
    openapi_extra=QUERY_BODY,
)
async def query(request: Request, container: Service, collection: InCollection) -> QueryAnswer:
    """Search with a mesh file, or with a stored shape by its id, whatever pose either is in.

    Options are fields of the form, or of the JSON object, or parameters of the address.
    """
    given = {name: request.query_params.getlist(name) for name in request.query_params}
    address = {name: values for name, values in given.items() if name != PARAMETER}
    # Also what the body overrides must be sound.
    _validated(
        QueryOptions, _values({name: values for name, values in address.items() if name != "shape_id"})
    )
    if is_form(request):
        return await _with_file(request, container, collection.number, address)
    if is_json(request):
        return await _with_id(request, container, collection.number, address)
    raise UnsupportedBodyError("the body must be multipart/form-data with a file, or JSON with a shape_id")


@router.post(
    "/compare",
    summary="Compare two stored shapes",
    response_model=CompareAnswer,
    responses={
        200: {
            "description": "The scores and the points; or a GLB with both meshes; or a page that shows them.",
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
            description="glb is both meshes side by side, points that correspond coloured alike; html a page "
            "that shows them in a browser that may ask this service for the two shapes."
        ),
    ] = "json",
) -> CompareAnswer | Response:
    """How alike two stored shapes are, and which of their points correspond."""
    timings, own = Timings(), collection.number

    async def compared(active_pipeline: ActivePipeline) -> tuple[Comparison, bytes]:
        found = await service.compare(container, own, pair.first, pair.second, active_pipeline, timings)
        if format != "glb":
            return found, b""
        with timings.stage("draw"):
            return found, await coloured(container, own, pair.first, pair.second, found)

    with container.work.admitted():
        comparison, glb = await while_connected(request, service.in_one_pipeline(container, compared))
    container.metrics.stages("compare", timings.milliseconds)
    if format == "glb":
        return Response(glb, media_type=MEDIA_TYPE)
    if format == "html":
        return comparing_page(pair.first, pair.second, collection.name)
    return CompareAnswer.of(comparison, milliseconds=timings.so_far())


async def _with_file(
    request: Request, container: Container, collection: CollectionNumber, address: dict[str, list[str]]
) -> QueryAnswer:
    settings = container.settings
    async with uploaded(
        request, max_bytes=settings.max_upload_bytes, max_fields=settings.max_form_fields
    ) as form:
        options = _validated(QueryOptions, _values({**address, **form.fields}))
        mesh_format = format_of(form.filename)
        timings = Timings()
        with container.work.admitted():
            data = await form.bytes()

            async def found(active_pipeline: ActivePipeline) -> Answer:
                wanted = await service.by_file(
                    container, collection, data, mesh_format, active_pipeline, timings
                )
                how = _options(options, container, collection, exclude_self=False)
                if options.partial:
                    return await partial.search(
                        container, wanted, lambda: container.work.read(data, mesh_format), how, timings
                    )
                return await service.search(container, wanted, how, timings)

            answer = await while_connected(request, service.in_one_pipeline(container, found))
    return _answer(answer, container, timings)


async def _with_id(
    request: Request, container: Container, collection: CollectionNumber, address: dict[str, list[str]]
) -> QueryAnswer:
    try:
        body = await request.json()
    except (ValueError, RecursionError) as error:
        raise BadRequestFieldsError(FieldFault("body", f"not JSON: {error}")) from error
    if not isinstance(body, dict):
        raise BadRequestFieldsError(FieldFault("body", "must be a JSON object"))
    options = _validated(StoredQuery, {**_values(address), **body})
    timings = Timings()
    with container.work.admitted():

        async def found(active_pipeline: ActivePipeline) -> Answer:
            wanted = await service.by_id(container, collection, options.shape_id, active_pipeline, timings)
            how = _options(options, container, collection, exclude_self=True)
            if options.partial:
                stored = partial.stored_mesh
                return await partial.search(
                    container,
                    wanted,
                    lambda: stored(container, collection, options.shape_id, active_pipeline.fingerprint),
                    how,
                    timings,
                )
            return await service.search(container, wanted, how, timings)

        answer = await while_connected(request, service.in_one_pipeline(container, found))
    return _answer(answer, container, timings)


def _answer(answer: Answer, container: Container, timings: Timings) -> QueryAnswer:
    container.metrics.stages("query", timings.milliseconds)
    return QueryAnswer.of(answer, milliseconds=timings.so_far())


def _values(fields: dict[str, list[str]]) -> dict[str, Any]:
    """The text fields of a form or an address, of which lists alone may be repeated."""
    return {name: values if name in REPEATED else single(fields, name) for name, values in fields.items()}


def _validated(model: type[Model], values: dict[str, Any]) -> Model:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise BadRequestFieldsError(*faults_of(error.errors())) from error


def _options(
    given: QueryOptions, container: Container, collection: CollectionNumber, *, exclude_self: bool
) -> Options:
    shapes = given.filtered(collection)
    return Options(
        top_k=given.top_k,
        rank_by=given.rank_by,
        exhaustive=given.exhaustive,
        filter=replace(shapes, tags=(*given.tag, *given.filter), excluded=tuple(given.exclude)),
        exclude_self=exclude_self if given.exclude_self is None else given.exclude_self,
        min_cc=-1.0 if given.min_cc is None else given.min_cc,
        sizes=SAME_SIZE if given.scale == "respect" else None,
        correspondences=given.correspondences,
        embedding=given.embedding,
        shortlist_from=container.settings.shortlist_from,
        shortlist_length=container.settings.shortlist_length,
        reranked=container.settings.reranked,
        finalists=container.settings.finalists,
    )
