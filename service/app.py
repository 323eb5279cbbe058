"""The application: settings in, the ASGI application with all routers and middleware out."""

import asyncio
import json
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import cache, partial
from inspect import iscoroutinefunction
from threading import Event
from typing import Any

from cachetools import LRUCache
from fastapi import APIRouter, Depends, FastAPI, Request
from starlette.concurrency import run_in_threadpool
from starlette.routing import BaseRoute
from threadpoolctl import threadpool_limits

from core.parameters import Parameters
from service.auth.gate import Gate
from service.auth.keys import KeyRing
from service.collections.endpoints import PARAMETER
from service.collections.endpoints import PROBLEMS as CHOOSING_PROBLEMS
from service.collections.endpoints import router as collections_router
from service.compute.compilation import is_compiled
from service.compute.pool import LocalPool
from service.compute.request_queue import ActivityGate, Executor, RequestQueue, end, start_executors
from service.container import Container
from service.duplicates.decision_endpoints import router as decisions_router
from service.duplicates.endpoints import router as duplicates_router
from service.duplicates.service import keep_judging
from service.http.body_limits import BodyLimit, ClientQuotas
from service.http.idempotency import InFlight
from service.http.middleware import AccessControl, RequestContext
from service.http.openapi import DESCRIPTION, TAGS, describe
from service.http.problems import handle_problems
from service.index.cache import EmbeddingCache
from service.index.signature_table import SurfaceMeasurements
from service.jobs.endpoints import ADDRESS as JOBS_ADDRESS
from service.jobs.endpoints import router as jobs_router
from service.jobs.runner import Runner
from service.observability import logging
from service.observability.metrics import Metrics
from service.pipelines.active import Pipelines, begin
from service.previews.endpoints import router as pictures_router
from service.search.caches import CacheWarmer
from service.search.compare import router as compare_router
from service.search.endpoints import router as search_router
from service.settings import Settings, load_parameters
from service.shapes.endpoints import router as shapes_router
from service.shapes.file_endpoints import router as files_router
from service.shapes.service import keep_purging
from service.sources.endpoints import router as sources_router
from service.sources.scanner import Scanner
from service.storage.database import Database, migrate
from service.system.endpoints import router as service_router
from service.system.endpoints import session_router
from service.system.schemas import VERSION
from service.turns import Shares, Turns
from service.web.endpoints import router as page_router
from service.webhooks.sender import keep_telling

DESCRIPTOR_SHARE = 3
"""Descriptors have at most this part of the memory for search: 34 kB a shape, 108 kB an incomplete one."""

RELATIONS = 4096
"""Pairs of shapes of which it is kept what registration told: about 1 kB each."""

DOWNLOADS = 4
"""Files that each client receives at a time: each is in memory until its last byte is sent."""

FILE_BATCHES = 2
"""Batches of files that each client sends at a time: each may take a hundred descriptors, or MB of memory."""

# In the order of the OpenAPI document.
ROUTERS = (
    search_router,
    compare_router,
    duplicates_router,
    decisions_router,
    shapes_router,
    files_router,
    jobs_router,
    sources_router,
    collections_router,
    session_router,
    service_router,
    pictures_router,
    page_router,
)

log = logging.get_logger("app")


def create_app(settings: Settings, *, watches: bool = False) -> FastAPI:
    """Create the application. Opens and starts nothing before its lifespan begins.

    With `watches`, it scans sources when their folders change; otherwise it scans those that it is asked to.
    Raise SettingsError if the file of parameters is invalid.
    """
    parameters = load_parameters(settings.pipeline)
    hosts = None if settings.has_keys and not settings.hosts else {*settings.hosts, settings.host}
    gate = Gate(KeyRing(settings.api_keys, settings.read_keys), settings.rate_limit, hosts)
    metrics = Metrics()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        logging.configure(settings.log_level)
        app.state.container = await run_in_threadpool(_start, settings, parameters, gate, metrics)
        app.state.runner = Runner(app.state.container)
        app.state.runner.start()
        app.state.scanner = Scanner(app.state.container, watches=watches)
        app.state.scanner.start()
        works = [CacheWarmer(app.state.container).run(), keep_purging(app.state.container)]
        # Judging reads all signatures into memory, which this setting avoids.
        if settings.duplicates_in_background and settings.signatures == "memory":
            works.append(keep_judging(app.state.container))
        if settings.webhook_url:
            works.append(keep_telling(app.state.container))
        beside = [asyncio.create_task(work) for work in works]
        metrics.watch(
            "job_files", "Files of bulk jobs that are at work.", lambda: app.state.runner.active_members
        )
        try:
            yield
        finally:
            await asyncio.gather(*map(end, beside))
            await app.state.scanner.stop()
            await app.state.runner.stop()
            await run_in_threadpool(_stop, app.state.container)

    app = FastAPI(
        title="Isoshape",
        version=VERSION,
        summary="Finds, among stored 3D shapes, those most like an uploaded one, whatever their pose.",
        description=DESCRIPTION,
        openapi_tags=TAGS,
        lifespan=lifespan,
        redirect_slashes=False,
        # FastAPI's own pages load scripts from a public server.
        docs_url=None,
        redoc_url=None,
    )
    app.state.settings = settings
    app.router.routes.extend(_routes())
    app.add_middleware(AccessControl, gate=gate)
    app.add_middleware(
        BodyLimit,
        file_bytes=settings.max_upload_bytes,
        larger={JOBS_ADDRESS: settings.max_archive_bytes, "/compare": 2 * settings.max_upload_bytes},
        # More could not wait for a worker.
        quotas=ClientQuotas(
            settings.workers + settings.queue_length,
            max(settings.max_upload_bytes, settings.max_archive_bytes),
        ),
        seconds=settings.receive_seconds,
    )
    app.add_middleware(RequestContext, metrics=metrics)
    handle_problems(app)
    describe(app, {PARAMETER: CHOOSING_PROBLEMS})
    return app


@cache
def _routes() -> list[BaseRoute]:
    """Return the routes. Applications share them: FastAPI prepares each at its first use, all in 0.2 s."""
    every = APIRouter()
    for router in ROUTERS:
        # The files of the page are not in the database.
        turns = [] if router is page_router else [Depends(_turn_in_thread, scope="function")]
        every.include_router(router, dependencies=turns)
    return every.routes


async def _turn_in_thread(request: Request) -> AsyncIterator[None]:
    """Let an endpoint that runs in a thread wait for the turn of its client."""
    if iscoroutinefunction(request.scope["route"].endpoint):
        yield
    else:
        async with request.app.state.container.database.turn():
            yield


def openapi_document() -> dict[str, Any]:
    """Return the OpenAPI document, which does not depend on settings or environment."""
    return create_app(Settings.model_construct()).openapi()


def openapi_text() -> str:
    """Return the document as a file, always the same for the same service."""
    return json.dumps(openapi_document(), indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def _start(settings: Settings, parameters: Parameters, gate: Gate, metrics: Metrics) -> Container:
    """Start the workers, open and migrate the database, and adopt its pipeline."""
    threadpool_limits(1)
    pool, readers = start_executors(
        settings, parameters, lambda cause: metrics.worker_replacements.labels(cause).inc()
    )
    try:
        database = Database(
            settings.database_url, lock_seconds=settings.lock_seconds, metrics=metrics, reserve=True
        )
        migrate(database)
        pipelines = Pipelines(parameters, room=settings.search_bytes)
        begin(pipelines, database, in_memory=settings.signatures == "memory")
    except BaseException:
        readers.kill()
        pool.kill()
        raise
    queue = RequestQueue(
        pool,
        readers,
        settings.limits,
        settings.read_seconds,
        settings.workers,
        settings.queue_length,
        compiling=lambda: not (settings.scheduler or pool.pids() or is_compiled(parameters)),
    )
    log.info("the service starts", extra={"fields": {"version": VERSION, "workers": settings.workers}})
    _watch(metrics, pool, readers, queue, pipelines)
    threads = ThreadPoolExecutor(settings.workers, thread_name_prefix="compare")
    return Container(
        settings=settings,
        database=database,
        pool=pool,
        readers=readers,
        queue=queue,
        pipelines=pipelines,
        gate=gate,
        in_flight=InFlight(),
        metrics=metrics,
        threads=threads,
        batches=Turns(2 * settings.workers),
        downloads=Shares(DOWNLOADS),
        file_batches=Shares(FILE_BATCHES),
        searches=ActivityGate(),
        comparing_is_ready=Event(),
        descriptors=EmbeddingCache(settings.search_bytes // DESCRIPTOR_SHARE),
        measurements=SurfaceMeasurements(),
        judging=set(),
        relations=LRUCache(RELATIONS),
    )


def _watch(
    metrics: Metrics, pool: Executor, readers: LocalPool, queue: RequestQueue, pipelines: Pipelines
) -> None:
    """Register gauges that read the state of the components."""
    watch = metrics.watch
    watch("queue_requests", "Requests that are at work or wait for a worker.", lambda: queue.inside)
    watch("queue_room", "How many may be, before the next is answered 503.", lambda: queue.room)
    for name, about, processes in (
        ("workers", "Worker processes by what they do.", pool),
        ("readers", "Processes that read uploads by what they do.", readers),
    ):
        for state in ("idle", "busy", "starting"):
            watch(name, about, partial(_count, processes, state), state=state)
    watch("tasks_waiting", "Tasks that no worker has taken yet.", partial(_count, pool, "waiting"))
    watch(
        "indexed_shapes",
        "Shapes whose signatures are in memory, as of the last query.",
        lambda: pipelines.indexed,
    )
    watch("rows_bytes", "Memory of the match records in the cache.", lambda: pipelines.cached_bytes)


def _count(processes: Executor, state: str) -> int:
    count: int = getattr(processes.counts(), state)
    return count


def _stop(container: Container) -> None:
    """Stop all components; unfinished work is abandoned."""
    container.threads.shutdown(cancel_futures=True)
    container.readers.kill()
    container.pool.kill()
    container.database.close()
    log.info("the service has ended")
