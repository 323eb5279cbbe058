"""The addresses under /jobs."""

from collections.abc import AsyncIterator, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response, UploadFile
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from service.collections.dependencies import InCollection, address
from service.dependencies import Service
from service.errors import BusyError
from service.http.duplicate_parameters import once
from service.http.problems import documented
from service.http.request_bodies import RequestBody
from service.jobs import events, service
from service.jobs.members import shown
from service.jobs.records import NewJob, Outcome
from service.jobs.runner import Runner
from service.jobs.schemas import Job, JobFilePage, JobPage
from service.shapes.documentation import READ_PROBLEMS, WRITE_PROBLEMS
from service.shapes.fields import base_name
from service.shapes.pages import read_cursor
from service.shapes.uploads import FormMetadata, FormTags

ADDRESS = "/jobs"
ARCHIVE_CHARACTERS = 255

router = APIRouter(tags=["jobs"])

JobId = Annotated[str, Path(description="The id of a job.", max_length=64)]
Cursor = Annotated[str | None, Query(max_length=256, description="The `next_cursor` of the page before.")]
Limit = Annotated[int, Query(ge=1, le=500, description="How many at most.")]


def _runner(request: Request) -> Runner:
    runner = request.app.state.runner
    assert isinstance(runner, Runner)
    return runner


Jobs = Annotated[Runner, Depends(_runner)]


async def _receiving(jobs: Jobs) -> AsyncIterator[None]:
    with jobs.arriving():
        yield


class ArchiveUpload(BaseModel):
    """An archive of meshes, and the text that people write about each of them."""

    model_config = ConfigDict(extra="forbid")

    file: UploadFile = Field(
        description="The archive: zip (stored or deflated), or tar, plain or compressed by gzip, bzip2 or "
        "xz. The service reads the format from the content, not from the file's name."
    )
    tags: FormTags
    metadata: FormMetadata


ARCHIVE = RequestBody(ArchiveUpload, limit="max_archive_bytes")


@router.post(
    ADDRESS,
    status_code=202,
    summary="Store an archive of meshes",
    response_model=Job,
    response_description="The archive is durable, and the job has its turn; Location names it.",
    responses=documented(
        "bad-request",
        "bad-request-fields",
        "body-too-large",
        "unsupported-media-type",
        "unknown-archive",
        "archive-too-large",
        "busy",
        *WRITE_PROBLEMS,
    ),
    # Before the body is read: only so many archives are received at a time.
    dependencies=[Depends(_receiving, scope="function")],
    openapi_extra=ARCHIVE.openapi,
)
async def create_job(
    response: Response,
    container: Service,
    jobs: Jobs,
    collection: InCollection,
    upload: Annotated[ArchiveUpload, Depends(ARCHIVE, scope="function")],
) -> Job:
    """Have every mesh in a zip or tar stored as by an upload of its own, with these tags and this metadata.

    A shape has the name of its file, without the folders. A file that cannot be stored is refused with its
    cause, and does not hold up the others. The job outlives a restart of the service.
    """
    settings, file = container.settings, upload.file
    format = await run_in_threadpool(service.format_of_archive, file.file, settings)
    new = NewJob(
        collection=collection.number,
        archive=shown(base_name(file.filename or ""))[:ARCHIVE_CHARACTERS],
        format=format,
        size=file.size or 0,
        tags=tuple(upload.tags),
        metadata=upload.metadata,
    )
    job = await run_in_threadpool(service.receive, container.database, file.file, new, settings.max_jobs)
    jobs.look()
    response.headers["Location"] = address(f"{ADDRESS}/{job.id}", collection)
    return await run_in_threadpool(events.read, container.database, collection.number, job.id)


@router.get(
    ADDRESS,
    summary="List jobs",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once("cursor", "limit")],
)
def list_jobs(
    container: Service, collection: InCollection, cursor: Cursor = None, limit: Limit = 50
) -> JobPage:
    """The jobs that have not ended, or ended in the last days, the latest first."""
    before = read_cursor(cursor)
    with container.database.read() as session:
        return JobPage.of(service.list_page(session, collection.number, before=before, limit=limit))


@router.get("/jobs/{job_id}", summary="Read a job", responses=documented("job-not-found", *READ_PROBLEMS))
def read_job(job_id: JobId, container: Service, collection: InCollection) -> Job:
    """How far a job is, and when it will have ended."""
    return events.read(container.database, collection.number, job_id)


@router.get(
    "/jobs/{job_id}/files",
    summary="List the files of a job",
    responses=documented("job-not-found", *READ_PROBLEMS),
    dependencies=[once("outcome", "cursor", "limit")],
)
def list_job_files(
    job_id: JobId,
    container: Service,
    collection: InCollection,
    outcome: Annotated[Outcome | None, Query(description="Only files of which this became.")] = None,
    cursor: Cursor = None,
    limit: Limit = 50,
) -> JobFilePage:
    """What became of each file of the archive, in its order; none before the job has begun."""
    after = read_cursor(cursor)
    with container.database.read() as session:
        found = service.list_files(session, collection.number, job_id, outcome, after=after, limit=limit)
        return JobFilePage.of(found)


@router.get(
    "/jobs/{job_id}/events",
    summary="Follow a job",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "Server-sent events: `progress` whenever the job has come further, and `end` when "
            "it has ended, each with the job as JSON.",
            "content": {events.MEDIA_TYPE: {"itemSchema": events.EVENT}},
        },
        204: {"description": "The client has had the end, by its Last-Event-ID, and need not come back."},
        **documented("job-not-found", "busy", *READ_PROBLEMS),
    },
)
async def follow_job(
    job_id: JobId, request: Request, container: Service, jobs: Jobs, collection: InCollection
) -> Response:
    """The progress of a job as an `EventSource` in a page reads it; the stream ends with the job."""
    job = await run_in_threadpool(events.read, container.database, collection.number, job_id)
    last = request.headers.get("Last-Event-ID")
    if job.has_ended and last == events.name_of(job):
        return Response(status_code=204)
    if len(jobs.followers) >= events.FOLLOWERS:
        raise BusyError(f"{events.FOLLOWERS} clients follow jobs already; GET /jobs/{job_id} tells as much")
    ending: Callable[[], bool] = request.scope.get(events.ENDING_IN_SCOPE, lambda: False)
    return StreamingResponse(
        events.events(container.database, collection.number, job, jobs.followers, ending, last),
        media_type=events.MEDIA_TYPE,
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


@router.post(
    "/jobs/{job_id}/cancel",
    summary="Cancel a job",
    responses=documented("job-not-found", *WRITE_PROBLEMS),
)
async def cancel_job(job_id: JobId, container: Service, jobs: Jobs, collection: InCollection) -> Job:
    """Store nothing more of the archive. What is stored stays; a job that has ended is left as it is."""
    await run_in_threadpool(service.cancel, container.database, collection.number, job_id)
    jobs.look()
    return await run_in_threadpool(events.read, container.database, collection.number, job_id)


@router.delete(
    "/jobs/{job_id}",
    status_code=204,
    summary="Delete a job",
    responses=documented("job-not-found", *WRITE_PROBLEMS),
)
async def delete_job(job_id: JobId, container: Service, jobs: Jobs, collection: InCollection) -> None:
    """Cancel the job, unless it has ended, and delete its record. What it has stored stays."""
    await run_in_threadpool(service.remove, container.database, collection.number, job_id)
    jobs.look()
