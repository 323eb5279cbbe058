"""The address /duplicates."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from core.registration.similarity import RESIDUAL
from service.collections.endpoints import InCollection, NamedInAddress
from service.container import Service
from service.duplicates import service
from service.duplicates.groups import Counted, Search
from service.duplicates.schemas import DuplicatesAnswer
from service.http.middleware import while_connected
from service.http.problems import READ_PROBLEMS, documented
from service.http.request_bodies import once_each
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.search.answer import with_active_pipeline
from service.shapes.schemas import Filters

CSV, XLSX = "text/csv", "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"

JUDGING_PROBLEMS = (
    *("busy", "shutting-down", "worker-lost", "cluster-unavailable", "time-limit", "pipeline-unavailable"),
)

router = APIRouter(tags=["search"])


class DuplicatesOptions(NamedInAddress, Filters):
    """The shapes to search for near-identical ones, and the limits of near identity."""

    max_residual: float = Field(
        default=RESIDUAL,
        gt=0.0,
        le=RESIDUAL,
        description="The largest distance of two surfaces after the best rotation, reflection and scaling: "
        "the root mean square distance over both directions, over the square root of the area. Shapes are "
        "judged with the default, so that no higher value is possible.",
    )
    scaled: bool = Field(
        default=False, description="Also join copies, and variants, of other sizes: size counts otherwise."
    )
    mirrored: bool = Field(
        default=True, description="Also join mirror images; without, both hands of a part are two parts."
    )
    variants: bool = Field(
        default=False,
        description="Also join variants: rigid copies but for a local difference, such as one hole more.",
    )
    decided: bool = Field(
        default=False, description="Also show shapes that are decided (POST /duplicates/decisions)."
    )
    judging_seconds: float | None = Field(
        default=None,
        ge=0.0,
        le=service.JUDGING_SECONDS,
        description="How long to judge shapes that are not judged yet, by default and at most "
        f"{service.JUDGING_SECONDS:g} seconds; 0: none is.",
    )
    limit: int | None = Field(
        default=None,
        ge=0,
        description="The largest number of groups in the answer, by default all; 0: only the numbers.",
    )
    format: Literal["json", "csv", "xlsx"] = Field(
        default="json", description="csv or xlsx: one row for each shape."
    )


@router.get(
    "/duplicates",
    summary="Find near-identical shapes",
    response_model=DuplicatesAnswer,
    dependencies=[once_each(DuplicatesOptions)],
    responses={
        200: {
            "description": "The groups.",
            "content": {
                media_type: {"schema": {"type": "string", "contentMediaType": media_type}}
                for media_type in (CSV, XLSX)
            },
        },
        **documented(*JUDGING_PROBLEMS, *READ_PROBLEMS),
    },
)
async def duplicates(
    options: Annotated[DuplicatesOptions, Query()],
    request: Request,
    container: Service,
    collection: InCollection,
) -> DuplicatesAnswer | Response:
    """Find groups of shapes with one rigid form: rotated, moved, mirrored or remeshed copies.

    Copies of other sizes are duplicates with `scaled`, and two poses of one body never are. The service
    judges stored shapes while it is idle, and keeps the pairs. A request judges missing shapes, and begins no
    further one after `judging_seconds`; `unjudged` says how many remain.
    """
    timings = Timings()
    shapes = options.filtered(collection)

    async def find_groups(active_pipeline: ActivePipeline) -> DuplicatesAnswer:
        fingerprint = active_pipeline.fingerprint
        bounds = Search(fingerprint, options.variants, options.max_residual)
        counted = Counted(options.scaled, options.mirrored, options.decided)
        return await service.find(
            container,
            shapes,
            bounds,
            counted,
            active_pipeline,
            timings,
            seconds=options.judging_seconds,
            limit=options.limit,
            with_paths=collection.shows_paths,
        )

    async with container.queue.admitted(request):
        answer = await while_connected(request, with_active_pipeline(container, find_groups))
    if options.format == "csv":
        return Response(answer.csv(), media_type=CSV)
    if options.format == "xlsx":
        return Response(await run_in_threadpool(answer.xlsx), media_type=XLSX)
    return answer
