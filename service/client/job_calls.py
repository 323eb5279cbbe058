"""The calls on bulk jobs."""

from collections.abc import Mapping, Sequence
from typing import Literal

from pydantic import JsonValue

from service.client.calls import LONGEST_PAGE, Call, File, Step, given, nothing, pages, parsed, segment
from service.client.shape_calls import fields_of
from service.jobs.schemas import Job, JobFile, JobFilePage, JobPage


def send_archive(
    archive: File,
    *,
    tags: Sequence[str] = (),
    metadata: Mapping[str, JsonValue] | None = None,
) -> Call[Job]:
    """Start a job that stores every mesh of a zip or tar archive, with tags and metadata."""
    fields = fields_of(None, tags, metadata)
    return Call("POST", "/jobs", parsed(Job), data=fields, file=archive, streamed=True)


def job(job_id: str) -> Call[Job]:
    """Get the progress of a job."""
    return Call("GET", f"/jobs/{segment(job_id)}", parsed(Job))


def follow_job(job_id: str, *, seconds: float = 1.0) -> Call[Step[Job]]:
    """Get the progress of a job every `seconds` seconds; the last item is the ended job."""

    def step(now: Job) -> Step[Job]:
        return Step([now], None if now.has_ended else follow_job(job_id, seconds=seconds), seconds)

    return job(job_id).then(step)


def jobs() -> Call[Step[Job]]:
    """List the jobs that run or ended in the last days, the latest first."""

    def one(cursor: str | None) -> Call[JobPage]:
        return Call("GET", "/jobs", parsed(JobPage), params=given(limit=LONGEST_PAGE, cursor=cursor))

    return pages(one, lambda found: found.jobs)


def job_files(
    job_id: str, *, outcome: Literal["stored", "present", "refused"] | None = None
) -> Call[Step[JobFile]]:
    """List the files of a job's archive with their outcomes, in the order of the archive."""

    def one(cursor: str | None) -> Call[JobFilePage]:
        wanted = given(limit=LONGEST_PAGE, outcome=outcome, cursor=cursor)
        return Call("GET", f"/jobs/{segment(job_id)}/files", parsed(JobFilePage), params=wanted)

    return pages(one, lambda found: found.files)


def cancel_job(job_id: str) -> Call[Job]:
    """Stop a job; the shapes that it has stored stay."""
    return Call("POST", f"/jobs/{segment(job_id)}/cancel", parsed(Job))


def delete_job(job_id: str) -> Call[None]:
    """Cancel a job and delete its record; the shapes that it has stored stay."""
    return Call("DELETE", f"/jobs/{segment(job_id)}", nothing)
