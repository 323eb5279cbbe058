"""The address /duplicates."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from service.collections.dependencies import InCollection
from service.dependencies import Service
from service.duplicates import service
from service.duplicates.options import DuplicatesOptions
from service.duplicates.schemas import DuplicatesAnswer
from service.duplicates.service import Duplicates
from service.http.disconnects import while_connected
from service.http.duplicate_parameters import once_each
from service.http.problems import documented
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.search.service import in_one_pipeline

MEDIA_TYPE = "text/csv"

router = APIRouter(tags=["search"])


@router.get(
    "/duplicates",
    summary="Find near-identical shapes",
    response_model=DuplicatesAnswer,
    dependencies=[once_each(DuplicatesOptions)],
    responses={
        200: {
            "description": "The groups.",
            "content": {MEDIA_TYPE: {"schema": {"type": "string", "contentMediaType": MEDIA_TYPE}}},
        },
        **documented(
            "bad-request-fields",
            "busy",
            "shutting-down",
            "worker-lost",
            "cluster-unavailable",
            "time-limit",
            "pipeline-unavailable",
            "storage-unavailable",
        ),
    },
)
async def duplicates(
    options: Annotated[DuplicatesOptions, Query()],
    request: Request,
    container: Service,
    collection: InCollection,
) -> DuplicatesAnswer | Response:
    """Groups of shapes with one rigid form: rotated, moved, scaled, mirrored or remeshed copies.

    Two poses of one body are not duplicates. The service judges stored shapes while it is idle, and keeps the
    pairs. A request judges missing shapes, and begins no further one after 20 seconds; `unjudged` says how
    many remain.
    """
    timings = Timings()
    wanted = options.wanted(collection.number)

    async def found(active_pipeline: ActivePipeline) -> Duplicates:
        return await service.find(container, wanted, active_pipeline, timings)

    with container.queue.admitted():
        groups = await while_connected(request, in_one_pipeline(container, found))
    answer = DuplicatesAnswer.of(groups, milliseconds=timings.so_far())
    if options.format == "csv":
        return Response(answer.csv(), media_type=MEDIA_TYPE)
    return answer
