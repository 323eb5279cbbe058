"""The endpoints of the service itself: health, version, metrics, and signing in."""

from typing import Literal

from fastapi import APIRouter, Request, Response
from fastapi.responses import PlainTextResponse
from prometheus_client.exposition import choose_encoder
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from core.descriptors.registry import computed_descriptors
from core.io import FORMATS
from core.parameters import METHOD_VERSION
from service.auth.gate import name_in, token_in
from service.auth.keys import COOKIE, SECONDS
from service.collections.endpoints import limits_of
from service.compute.compilation import is_compiled
from service.container import Service
from service.errors import REEMBED, CompilingError, ServiceError
from service.http.problems import documented, problem_response
from service.system.schemas import VERSION, FileFormat, Health, PendingPipeline, Readiness, Version

router = APIRouter(tags=["service"])


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
    # Anybody may ask, and as often as they like.
    async with container.database.turn():
        try:
            await run_in_threadpool(container.database.ping)
            # Takes up the pipeline that the archive is searched by, if this service has it.
            await container.database.reading(container.pipelines.current)
        except ServiceError as error:
            faults.append(str(error))
    if not await run_in_threadpool(container.pool.ready):
        compiled = await run_in_threadpool(is_compiled, container.pipelines.wanted)
        faults.append(
            "no worker process is ready yet"
            if compiled or container.settings.scheduler
            else str(CompilingError())
        )
    if not await run_in_threadpool(container.readers.ready):
        faults.append("no process that reads uploads is ready yet")
    if not container.comparing_is_ready.is_set():
        faults.append("what compares shapes is not loaded yet")
    if faults:
        return problem_response("not-ready", "; ".join(faults), headers={"Retry-After": "1"})
    return Readiness()


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
    """Return the service's version, the formats of mesh files, and the active pipeline.

    Where the settings name another pipeline, `pending` tells of that one; but not to keys that are limited to
    collections, since it counts the files of all.
    """
    with container.database.read() as session:
        parameters = container.pipelines.current(session).pipeline.parameters
        counts = container.pipelines.pending(session) if limits_of(request) is None else None
    wanted, pending = container.pipelines.wanted, None
    if counts is not None:
        pending = PendingPipeline(
            name=wanted.name,
            fingerprint=wanted.fingerprint,
            embedded=counts[0],
            files=counts[1],
            message=REEMBED,
        )
    return Version(
        version=VERSION,
        pipeline=parameters.name,
        fingerprint=parameters.fingerprint,
        method=METHOD_VERSION,
        rank_by=container.settings.rank_by,
        descriptors=list(computed_descriptors()),
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
        pending=pending,
    )


session_router = APIRouter(tags=["session"])


class Session(BaseModel):
    """The rights of this browser or program."""

    access: Literal["none", "read", "full"] = Field(
        description="Nothing; read, query and compare; or everything, as all may do where there are no keys."
    )
    signed_in: bool = Field(description="Whether a cookie says so, which signing out ends.")


@session_router.get("/session", summary="What may I do?", responses=documented("unauthorized"))
async def read_session(request: Request, container: Service) -> Session:
    """Answers without a key too: a page asks it whether to sign in first."""
    grant = container.gate.grant(request.headers)
    if grant is None:
        return Session(access="none", signed_in=False)
    return Session(access=grant.level, signed_in=grant.signed_in)


@session_router.post("/session", summary="Sign in")
async def begin_session(request: Request, response: Response, container: Service) -> Session:
    """Trade a key, in a header, for a cookie that the page's scripts cannot read; it lasts twelve hours."""
    grant = container.gate.grant(request.headers)
    assert grant is not None
    if grant.digest is None or grant.signed_in:
        return Session(access=grant.level, signed_in=grant.signed_in)
    response.set_cookie(
        COOKIE,
        container.gate.sessions.begin(grant, name_in(request.headers.get("host", ""))),
        max_age=SECONDS,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return Session(access=grant.level, signed_in=True)


@session_router.delete("/session", status_code=204, summary="Sign out")
async def end_session(request: Request, response: Response, container: Service) -> None:
    """End the session, if there is one, and drop its cookie."""
    token = token_in(request.headers)
    if token is not None:
        container.gate.sessions.end(token)
    response.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=request.url.scheme == "https")
