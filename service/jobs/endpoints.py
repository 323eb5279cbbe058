"""The addresses under /jobs, of which one streams server-sent events (the `text/event-stream` of HTML)."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request, Response, UploadFile
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from service.collections.endpoints import InCollection, address
from service.errors import BusyError, ServiceError
from service.http.middleware import client_of
from service.http.problems import READ_PROBLEMS, WRITE_PROBLEMS, documented
from service.http.request_bodies import RequestBody, once_each
from service.jobs.runner import Runner
from service.jobs.schemas import Job, JobFilePage, JobPage, Outcome
from service.jobs.zip_archive import check_zip, shown
from service.shapes.endpoints import FormMetadata, FormTags, PageOptions
from service.shapes.fields import Id, base_name
from service.shapes.schemas import read_cursor
from service.turns import counted, current_client

ADDRESS = "/jobs"
ARCHIVE_CHARACTERS = 255

MEDIA_TYPE = "text/event-stream"
# The schema of an event in the OpenAPI document.
EVENT: dict[str, Any] = {
    "type": "object",
    "required": ["id", "event", "data"],
    "properties": {
        "id": {"type": "string", "description": "What to send as Last-Event-ID."},
        "event": {"type": "string", "enum": ["progress", "end"]},
        "data": {
            "type": "string",
            "contentMediaType": "application/json",
            "contentSchema": {"$ref": "#/components/schemas/Job"},
        },
    },
}
# The server sets this key of the ASGI scope to a function that tells whether the server is stopping.
ENDING_IN_SCOPE = "isoshape.ending"
# The most open streams. Each reads the database twice a second. A client has at most as many as stay free.
FOLLOWERS = 100
LOOK_SECONDS = 0.5
# Proxies and networks close idle connections.
SILENCE_SECONDS = 15.0
RECONNECT_MILLISECONDS = 2000

router = APIRouter(tags=["jobs"])

JobId = Annotated[Id, Path(description="The id of a job.")]


def _runner(request: Request) -> Runner:
    runner = request.app.state.runner
    assert isinstance(runner, Runner)
    return runner


InRunner = Annotated[Runner, Depends(_runner)]


async def _receiving(request: Request, runner: InRunner, _collection: InCollection) -> AsyncIterator[None]:
    # The collection comes first: without a right to it there is no place among the archives received.
    with runner.arriving(client_of(request.scope)):
        yield


async def _following(runner: InRunner, _collection: InCollection) -> AsyncIterator[None]:
    """Count a stream of a client until it ends; refuse it unless more may be opened than the client has."""
    client, total = current_client.get(), runner.followers.total()
    own = runner.followers[client]
    if own >= FOLLOWERS - total:
        raise BusyError(f"{total} streams are open, {own} of them of this client; GET the job instead")
    with counted(runner.followers, client):
        yield


class ArchiveUpload(BaseModel):
    """An archive of meshes, and the text that people write about each of them."""

    model_config = ConfigDict(extra="forbid")

    file: UploadFile = Field(
        description="The archive: a zip, stored or deflated. The name of the file may end otherwise."
    )
    tags: FormTags
    metadata: FormMetadata


class FileListing(PageOptions):
    """A page of a job's files."""

    outcome: Outcome | None = Field(default=None, description="Only files with this outcome.")


ARCHIVE = RequestBody(ArchiveUpload, limit="max_archive_bytes")


@router.post(
    ADDRESS,
    status_code=202,
    summary="Store an archive of meshes",
    response_model=Job,
    response_description="The archive is stored durably, and the job waits for its turn; Location is its "
    "URL.",
    responses=documented("unsupported-media-type", "unknown-archive", "busy", *WRITE_PROBLEMS),
    # Before the body is read: only so many archives are received at a time.
    dependencies=[Depends(_receiving, scope="function")],
    openapi_extra=ARCHIVE.openapi,
)
async def create_job(
    response: Response,
    runner: InRunner,
    collection: InCollection,
    upload: Annotated[ArchiveUpload, Depends(ARCHIVE, scope="function")],
) -> Job:
    """Store every mesh of a zip as a single upload would, with these tags and this metadata.

    A shape has the name of its file, without the folders. A file that cannot be stored is refused with a
    cause, and the job goes on with the others. The job survives a restart of the service.
    """
    file = upload.file
    await run_in_threadpool(check_zip, file.file)
    archive = shown(base_name(file.filename or ""))[:ARCHIVE_CHARACTERS]
    job = await run_in_threadpool(
        runner.jobs.receive,
        file.file,
        current_client.get(),
        collection.number,
        archive,
        upload.tags,
        upload.metadata,
    )
    runner.look()
    response.headers["Location"] = address(f"{ADDRESS}/{job.id}", collection)
    return job


@router.get(
    ADDRESS, summary="List jobs", responses=documented(*READ_PROBLEMS), dependencies=[once_each(PageOptions)]
)
def list_jobs(
    listing: Annotated[PageOptions, Query()], runner: InRunner, collection: InCollection
) -> JobPage:
    """Return the unfinished jobs, and those that ended in the last days, the latest first."""
    return runner.jobs.page(collection.number, before=read_cursor(listing.cursor), limit=listing.limit)


@router.get("/jobs/{job_id}", summary="Read a job", responses=documented("job-not-found", *READ_PROBLEMS))
def read_job(job_id: JobId, runner: InRunner, collection: InCollection) -> Job:
    """Return the progress of a job, and the time that it still needs."""
    return runner.jobs.read(collection.number, job_id)


@router.get(
    "/jobs/{job_id}/files",
    summary="List the files of a job",
    responses=documented("job-not-found", *READ_PROBLEMS),
    dependencies=[once_each(FileListing)],
)
def list_job_files(
    job_id: JobId, listing: Annotated[FileListing, Query()], runner: InRunner, collection: InCollection
) -> JobFilePage:
    """Return the outcome of each file of the archive, in its order; none until the job begins."""
    start = read_cursor(listing.cursor)
    return runner.jobs.files(collection.number, job_id, listing.outcome, start=start, limit=listing.limit)


@router.get(
    "/jobs/{job_id}/events",
    summary="Follow a job",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "Server-sent events: `progress` at each step of the job, and `end` at its end, "
            "each with the job as JSON.",
            "content": {MEDIA_TYPE: {"itemSchema": EVENT}},
        },
        204: {
            "description": "The client has the event `end` already, by its Last-Event-ID, and need not ask "
            "again."
        },
        **documented("job-not-found", "busy", *READ_PROBLEMS),
    },
    dependencies=[Depends(_following)],
)
async def follow_job(job_id: JobId, request: Request, runner: InRunner, collection: InCollection) -> Response:
    """Stream the progress of a job for `EventSource`; the stream ends with the job."""
    read = partial(runner.in_thread, partial(runner.jobs.read, collection.number, job_id))
    job = await read()
    last = request.headers.get("Last-Event-ID")
    if job.has_ended and last == _event_id(job):
        return Response(status_code=204)
    ending: Callable[[], bool] = request.scope.get(ENDING_IN_SCOPE, lambda: False)
    return StreamingResponse(
        _events(read, job, ending, last),
        media_type=MEDIA_TYPE,
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


@router.post(
    "/jobs/{job_id}/cancel", summary="Cancel a job", responses=documented("job-not-found", *WRITE_PROBLEMS)
)
async def cancel_job(job_id: JobId, runner: InRunner, collection: InCollection) -> Job:
    """Stop the job. Stored shapes stay; a job that has ended does not change."""
    await runner.in_thread(partial(runner.jobs.cancel, collection.number, job_id))
    runner.look()
    return await runner.in_thread(partial(runner.jobs.read, collection.number, job_id))


@router.delete(
    "/jobs/{job_id}",
    status_code=204,
    summary="Delete a job",
    responses=documented("job-not-found", *WRITE_PROBLEMS),
)
async def delete_job(job_id: JobId, runner: InRunner, collection: InCollection) -> None:
    """Cancel the job, unless it has ended, and delete its record. Stored shapes stay."""
    await runner.in_thread(partial(runner.jobs.cancel, collection.number, job_id, forget=True))
    runner.look()


def _event_id(job: Job) -> str:
    """Return the id of an event, which a reconnecting client sends as Last-Event-ID."""
    return f"{job.state}-{job.counts.files - job.counts.waiting}"


async def _events(
    read: Callable[[], Awaitable[Job]], job: Job, ending: Callable[[], bool], last: str | None
) -> AsyncIterator[str]:
    """Yield an event `progress` for each change of a job, and `end` when it has ended.

    `read` returns the current state of the job. `last` is the id of the last event that the client received.
    When `ending` returns true, the server is stopping and the stream ends; browsers then reconnect.
    """
    last_sent = time.monotonic()
    try:
        yield f"retry: {RECONNECT_MILLISECONDS}\n\n"
        while True:
            name = _event_id(job)
            if job.has_ended or name != last:
                last, last_sent = name, time.monotonic()
                kind = "end" if job.has_ended else "progress"
                yield f"id: {name}\nevent: {kind}\ndata: {job.model_dump_json()}\n\n"
            if job.has_ended or ending():
                return
            if time.monotonic() - last_sent > SILENCE_SECONDS:
                last_sent = time.monotonic()
                yield ": \n\n"
            await asyncio.sleep(LOOK_SECONDS)
            job = await read()
    except ServiceError:
        # The job was deleted, or the database fails; the next request of the client gets the error.
        return
