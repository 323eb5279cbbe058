"""The endpoint /compare."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from core.embedding import DenseCorrespondence
from service.collections.dependencies import InCollection
from service.container import Container
from service.dependencies import Service
from service.errors import BadRequestFieldsError, FieldFault
from service.http.middleware import while_connected
from service.http.problems import FILE_PROBLEMS, documented
from service.http.request_bodies import RequestBody, once_each
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.rendering.glb import MEDIA_TYPE
from service.search import service, tasks
from service.search.compare_schemas import (
    CompareForm,
    CompareParameters,
    dense_options,
)
from service.search.compared_shapes import ComparedShape, compared_shape, correspondences
from service.search.comparison_preview import coloured, painted
from service.search.dense_schemas import dense_fields
from service.search.endpoints import WORK_PROBLEMS
from service.search.records import Comparison, Relation
from service.search.schemas import CompareAnswer, CompareRequest
from service.web.endpoints import comparing_page

router = APIRouter(tags=["search"])

ZIP, PNG = "application/zip", "image/png"
BODY = RequestBody[CompareForm | CompareRequest](CompareForm, json=CompareRequest, either=("first", "second"))


@router.post(
    "/compare",
    summary="Compare two shapes",
    response_model=CompareAnswer,
    dependencies=[once_each(CompareParameters)],
    responses={
        200: {
            "description": "The scores and the corresponding points, with `dense` of all vertices; or a GLB, "
            "a page or a picture with both shapes, or a NumPy archive.",
            "content": {
                MEDIA_TYPE: {"schema": {"type": "string", "contentMediaType": MEDIA_TYPE}},
                "text/html": {"schema": {"type": "string"}},
                PNG: {"schema": {"type": "string", "contentMediaType": PNG}},
                ZIP: {"schema": {"type": "string", "contentMediaType": ZIP}},
            },
        },
        **documented(*FILE_PROBLEMS, *WORK_PROBLEMS, "storage-full"),
    },
    openapi_extra=BODY.openapi,
)
async def compare(
    request: Request,
    container: Service,
    collection: InCollection,
    options: Annotated[CompareParameters, Query()],
    body: Annotated[CompareForm | CompareRequest, Depends(BODY, scope="function")],
) -> Response | BaseModel:
    """The scores of two shapes, stored or sent, and their corresponding points.

    With `dense`, also the vertex of the second shape that corresponds to each vertex of the first, and where
    the two shapes differ. A shape is given by its id, or, in a form, by a file in the place of the id.
    """
    dense = dense_options(body, options)
    if options.format == "html" and not (isinstance(body.first, str) and isinstance(body.second, str)):
        raise BadRequestFieldsError(FieldFault("format", "html shows stored shapes, given by their ids"))
    timings = Timings()

    async def compared(active_pipeline: ActivePipeline) -> Response | BaseModel:
        first, second = [
            await compared_shape(container, collection.number, given, active_pipeline, timings)
            for given in (body.first, body.second)
        ]
        found, relation = await service.compare(
            container, collection.number, first, second, active_pipeline, timings
        )
        ways = await correspondences(container, first, second, active_pipeline, timings) if dense else None
        if ways is not None and options.format != "json":
            return await _dense_file(container, first, second, ways, options, timings)
        if options.format == "glb":
            with timings.stage("draw"):
                glb = await coloured(container, first, second, found)
            return Response(glb, media_type=MEDIA_TYPE)
        if ways is None:
            return CompareAnswer.of(found, relation, milliseconds=timings.so_far())
        return await run_in_threadpool(_dense_json, found, relation, ways, timings)

    with container.queue.admitted():
        answer = await while_connected(request, service.in_one_pipeline(container, compared))
    container.metrics.stages("compare", timings.milliseconds)
    if options.format == "html" and isinstance(body.first, str) and isinstance(body.second, str):
        return comparing_page(body.first, body.second, collection.name)
    return answer


async def _dense_file(
    container: Container,
    first: ComparedShape,
    second: ComparedShape,
    ways: tuple[DenseCorrespondence, DenseCorrespondence],
    options: CompareParameters,
    timings: Timings,
) -> Response:
    """A dense correspondence as a NumPy archive, a GLB or a picture."""
    if options.format == "npz":
        return Response(await container.queue.do(tasks.archive, ways[0]), media_type=ZIP)
    picture = options.format == "png"
    with timings.stage("draw"):
        drawn = await painted(container, first, second, ways, options.paint, picture=picture)
    return Response(drawn, media_type=PNG if picture else MEDIA_TYPE)


def _dense_json(
    found: Comparison,
    relation: Relation,
    ways: tuple[DenseCorrespondence, DenseCorrespondence],
    timings: Timings,
) -> Response:
    """The answer as JSON; for a large mesh it takes longer to write than the event loop may wait."""
    sparse = CompareAnswer.of(found, relation, milliseconds=timings.so_far())
    answer = sparse.model_copy(update=dense_fields(ways))
    return Response(answer.model_dump_json(), media_type="application/json")
