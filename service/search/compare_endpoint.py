"""The address /compare."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from core.dense.records import DenseCorrespondence
from service.collections.dependencies import InCollection
from service.dependencies import Service
from service.errors import BadRequestFieldsError, FieldFault
from service.http.disconnects import while_connected
from service.http.duplicate_parameters import once_each
from service.http.problems import documented
from service.http.request_bodies import RequestBody
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.rendering.glb import MEDIA_TYPE
from service.search import service, tasks
from service.search.compare_schemas import (
    CompareForm,
    CompareParameters,
    dense_options,
)
from service.search.compared_shapes import compared_shape, correspondences
from service.search.comparison_preview import coloured, painted
from service.search.dense_schemas import dense_fields
from service.search.endpoints import WORK_PROBLEMS
from service.search.records import Comparison, Relation
from service.search.schemas import CompareAnswer, CompareRequest
from service.shapes.documentation import FILE_PROBLEMS
from service.web.answers import comparing_page

router = APIRouter(tags=["search"])

ZIP = "application/zip"
BODY = RequestBody[CompareForm | CompareRequest](CompareForm, json=CompareRequest, either=("first", "second"))


@router.post(
    "/compare",
    summary="Compare two shapes",
    response_model=CompareAnswer,
    dependencies=[once_each(CompareParameters)],
    responses={
        200: {
            "description": "The scores and the corresponding points, with `dense` of all vertices; or a GLB "
            "with both meshes, or a page with them, or a NumPy archive.",
            "content": {
                MEDIA_TYPE: {"schema": {"type": "string", "contentMediaType": MEDIA_TYPE}},
                "text/html": {"schema": {"type": "string"}},
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
    address: Annotated[CompareParameters, Query()],
    body: Annotated[CompareForm | CompareRequest, Depends(BODY, scope="function")],
) -> Response | BaseModel:
    """The scores of two shapes, stored or sent, and their corresponding points.

    With `dense`, also the vertex of the second shape that corresponds to each vertex of the first, and where
    the two shapes differ. A shape is given by its id, or, in a form, by a file in the place of the id.
    """
    dense = dense_options(body, address)
    if address.format == "html" and not (isinstance(body.first, str) and isinstance(body.second, str)):
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
        if address.format == "npz" and ways is not None:
            archive = await container.work.do(tasks.archive, ways[0])
            return Response(archive, media_type=ZIP)
        if address.format == "glb":
            with timings.stage("draw"):
                glb = (
                    await coloured(container, first, second, found)
                    if ways is None
                    else await painted(container, first, second, ways, address.paint)
                )
            return Response(glb, media_type=MEDIA_TYPE)
        if ways is None:
            return CompareAnswer.of(found, relation, milliseconds=timings.so_far())
        return await run_in_threadpool(_dense_json, found, relation, ways, timings)

    with container.work.admitted():
        answer = await while_connected(request, service.in_one_pipeline(container, compared))
    container.metrics.stages("compare", timings.milliseconds)
    if address.format == "html" and isinstance(body.first, str) and isinstance(body.second, str):
        return comparing_page(body.first, body.second, collection.name)
    return answer


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
