"""The addresses under /jobs."""

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool

from service.collections.dependencies import InCollection, address
from service.dependencies import Service
from service.errors import BadRequestFieldsError, BusyError
from service.http.problem_document import faults_of
from service.http.problems import documented
from service.http.uploads import single, uploaded
from service.jobs import events, service
from service.jobs.members import shown
from service.jobs.records import NewJob, Outcome
from service.jobs.runner import Runner
from service.jobs.schemas import Job, JobFields, JobFilePage, JobPage
from service.shapes.documentation import READ_PROBLEMS, UPLOAD_BODY, WRITE_PROBLEMS
from service.shapes.fields import base_name, read_metadata, split_tags
from service.shapes.pages import read_cursor

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


def _body() -> dict[str, Any]:
    """The form, without the fields that are a single shape's."""
    form = UPLOAD_BODY["content"]["multipart/form-data"]["schema"]
    file = {
        "type": "string",
        "contentMediaType": "application/octet-stream",
        "description": "The archive: zip (stored or deflated), or tar as it is or packed by gzip, bzip2 or "
        "xz. Its name does not matter.",
    }
    properties = {
        "file": file,
        "tags": form["properties"]["tags"],
        "metadata": form["properties"]["metadata"],
    }
    return {
        "required": True,
        "content": {"multipart/form-data": {"schema": {**form, "properties": properties}}},
    }


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
    openapi_extra={"requestBody": _body()},
)
async def create_job(
    request: Request, response: Response, container: Service, jobs: Jobs, collection: InCollection
) -> Job:
    """Have every mesh in a zip or tar stored as by an upload of its own, with these tags and this metadata.

    A shape has the name of its file, without the folders. A file that cannot be stored is refused with its
    cause, and does not hold up the others. The job outlives a restart of the service.
    """
    settings = container.settings
    with jobs.arriving():
        async with uploaded(
            request, max_bytes=settings.max_archive_bytes, max_fields=settings.max_form_fields
        ) as form:
            fields = _fields(form.fields)
            format = await run_in_threadpool(service.format_of_archive, form.spooled, settings)
            new = NewJob(
                collection=collection.number,
                archive=shown(base_name(form.filename))[:ARCHIVE_CHARACTERS],
                format=format,
                size=form.size,
                tags=tuple(fields.tags),
                metadata=fields.metadata,
            )
            job = await run_in_threadpool(
                service.receive, container.database, form.spooled, new, settings.max_jobs
            )
    jobs.look()
    response.headers["Location"] = address(f"{ADDRESS}/{job.id}", collection)
    return await run_in_threadpool(events.read, container.database, collection.number, job.id)


@router.get(ADDRESS, summary="List jobs", responses=documented(*READ_PROBLEMS))
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


def _fields(form: dict[str, list[str]]) -> JobFields:
    """The text fields of the form, or a refusal that names what is wrong."""
    values: dict[str, Any] = {name: single(form, name) for name in form if name != "tags"}
    values["tags"] = split_tags(form.get("tags", []))
    values["metadata"] = read_metadata(values.get("metadata") or "{}")
    try:
        return JobFields.model_validate(values)
    except ValidationError as error:
        raise BadRequestFieldsError(*faults_of(error.errors())) from error
