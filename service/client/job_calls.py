"""What is sent about bulk jobs."""

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
    """Have every mesh in a zip or tar stored, with tags and metadata, by a job to be followed."""
    fields = fields_of(None, tags, metadata)
    return Call("POST", "/jobs", parsed(Job), data=fields, file=archive, streamed=True)


def job(job_id: str) -> Call[Job]:
    """How far a job is."""
    return Call("GET", f"/jobs/{segment(job_id)}", parsed(Job))


def follow_job(job_id: str, *, seconds: float = 1.0) -> Call[Step[Job]]:
    """How far a job is, asked every so many seconds until it has ended; that is the last."""

    def step(now: Job) -> Step[Job]:
        return Step([now], None if now.has_ended else follow_job(job_id, seconds=seconds), seconds)

    return job(job_id).then(step)


def jobs() -> Call[Step[Job]]:
    """The jobs that have not ended, or ended in the last days, the latest first."""

    def one(cursor: str | None) -> Call[JobPage]:
        return Call("GET", "/jobs", parsed(JobPage), params=given(limit=LONGEST_PAGE, cursor=cursor))

    return pages(one, lambda found: found.jobs)


def job_files(
    job_id: str, *, outcome: Literal["stored", "present", "refused"] | None = None
) -> Call[Step[JobFile]]:
    """What became of each file of a job's archive, in its order; of those with one outcome, or of all."""

    def one(cursor: str | None) -> Call[JobFilePage]:
        wanted = given(limit=LONGEST_PAGE, outcome=outcome, cursor=cursor)
        return Call("GET", f"/jobs/{segment(job_id)}/files", parsed(JobFilePage), params=wanted)

    return pages(one, lambda found: found.files)


def cancel_job(job_id: str) -> Call[Job]:
    """Store nothing more of a job's archive; what is stored stays."""
    return Call("POST", f"/jobs/{segment(job_id)}/cancel", parsed(Job))


def delete_job(job_id: str) -> Call[None]:
    """Cancel a job, and delete its record; what is stored stays."""
    return Call("DELETE", f"/jobs/{segment(job_id)}", nothing)
