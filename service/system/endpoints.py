"""The addresses that tell of the service itself."""

from dataclasses import asdict

from fastapi import APIRouter, Request, Response
from fastapi.responses import PlainTextResponse
from prometheus_client.exposition import choose_encoder
from starlette.concurrency import run_in_threadpool

from core.io import FORMATS
from core.parameters import METHOD_VERSION
from service.auth.keys import Grant
from service.compute.compilation import is_compiled
from service.dependencies import Service
from service.errors import ServiceError
from service.http.access_control import GRANT_IN_SCOPE
from service.http.problems import documented, problem_response
from service.system.schemas import VERSION, FileFormat, Health, PendingPipeline, Readiness, Version

router = APIRouter(tags=["service"])

COMPILING = "the kernels are compiled for this processor, once, which takes about a minute on an idle machine"


@router.get("/healthz", summary="Is the process alive?")
async def healthz() -> Health:
    """Answers as long as the process does; asks nothing of database or workers."""
    return Health()


@router.get(
    "/readyz", summary="Can it do its work?", response_model=Readiness, responses=documented("not-ready")
)
async def readyz(container: Service) -> Readiness | Response:
    """Asks the database which pipeline it is searched by, and a worker for an answer."""
    faults = []
    try:
        await run_in_threadpool(container.database.ping)
        await run_in_threadpool(_follow, container)
    except ServiceError as error:
        faults.append(str(error))
    if not await run_in_threadpool(container.pool.ready):
        compiled = await run_in_threadpool(is_compiled, container.pipelines.wanted)
        faults.append(
            "no worker process is ready yet" if compiled or container.settings.scheduler else COMPILING
        )
    if not await run_in_threadpool(container.readers.ready):
        faults.append("no process that reads uploads is ready yet")
    if not container.comparing_is_ready.is_set():
        faults.append("what compares shapes is not loaded yet")
    if faults:
        return problem_response("not-ready", "; ".join(faults), retry_after=1)
    return Readiness()


def _follow(container: Service) -> None:
    """Take up the pipeline that the archive is searched by, if this service has it."""
    with container.database.read() as session:
        container.pipelines.current(session)


@router.get(
    "/metrics",
    summary="What has it done, and how long did it take?",
    response_class=PlainTextResponse,
    responses={200: {"description": "Metrics in the text format of Prometheus, or that of OpenMetrics."}},
)
def read_metrics(request: Request, container: Service) -> Response:
    """For Prometheus: requests, stages, the queue, the workers and the database."""
    encode, media_type = choose_encoder(request.headers.get("accept", ""))
    return Response(encode(container.metrics.registry), media_type=media_type)


@router.get(
    "/version",
    summary="Which version is it?",
    responses=documented("pipeline-unavailable", "storage-unavailable"),
)
def read_version(request: Request, container: Service) -> Version:
    """The service's version, the formats of mesh files, and the pipeline that the archive is searched by.

    Where the settings name another pipeline, `pending` tells of that one; but not to keys that are limited to
    collections, since it counts the files of all.
    """
    grant: Grant | None = request.scope.get(GRANT_IN_SCOPE)
    limited = grant is not None and grant.collections is not None
    with container.database.read() as session:
        parameters = container.pipelines.current(session).pipeline.parameters
        pending = None if limited else container.pipelines.pending(session)
    return Version(
        version=VERSION,
        pipeline=parameters.name,
        fingerprint=parameters.fingerprint,
        method=METHOD_VERSION,
        formats=[
            FileFormat(
                name=known.name,
                title=known.title,
                endings=known.endings,
                media_type=known.media_type,
                read=known.is_read,
                written=known.is_written,
            )
            for known in FORMATS.values()
        ],
        pending=None if pending is None else PendingPipeline(**asdict(pending)),
    )
