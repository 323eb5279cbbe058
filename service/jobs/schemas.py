"""Jobs as JSON."""

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from service.errors import PROBLEMS
from service.http.problem_document import TYPE_PREFIX
from service.jobs import records
from service.jobs.records import FileRecord, FilesPage, JobRecord, JobsPage, Progress
from service.shapes.pages import write_cursor
from service.storage.job_states import ENDED

CAUSE: dict[str, Any] = {
    "type": TYPE_PREFIX + "member-damaged",
    "title": PROBLEMS["member-damaged"].title,
    "status": PROBLEMS["member-damaged"].status,
    "detail": "it cannot be unpacked: Bad CRC-32 for file 'cups/7.off'",
}
JOB: dict[str, Any] = {
    "id": "5d2c8e0a-93ff-4f6b-8a55-7b1f1a2f0d11",
    "state": "running",
    "archive": "parts.zip",
    "format": "zip",
    "bytes": 48211034,
    "tags": ["2026"],
    "metadata": {"source": "scan"},
    "counts": {"files": 195, "waiting": 120, "stored": 70, "present": 2, "refused": 3},
    "files_per_second": 2.4,
    "remaining_seconds": 50.0,
    "problem": None,
    "created_at": "2026-01-31T12:00:00Z",
    "started_at": "2026-01-31T12:00:01Z",
    "ended_at": None,
}
FILE: dict[str, Any] = {
    "place": 7,
    "path": "cups/7.off",
    "outcome": "refused",
    "shape_id": None,
    "problem": CAUSE,
}


class Cause(BaseModel):
    """Why something was not done: a problem (RFC 9457) that is no answer to a request."""

    model_config = ConfigDict(json_schema_extra={"example": CAUSE})

    type: str = Field(description="What kind of problem it is, as in the answers to requests.")
    title: str = Field(description="The same in words.")
    status: int = Field(description="The HTTP status that an upload of the file alone would have.")
    detail: str = Field(description="What happened this time, for a person.")

    @classmethod
    def of(cls, cause: records.FailureCause) -> "Cause":
        """The JSON of a cause."""
        row = PROBLEMS[cause.kind]
        return cls(type=TYPE_PREFIX + cause.kind, title=row.title, status=row.status, detail=cause.detail)


class Counts(BaseModel):
    """The files of an archive by what became of them; folders are no files."""

    files: int = Field(description="All of them; none before the archive has been listed.")
    waiting: int = Field(description="Nothing has become of them yet; or ever will, where the job has ended.")
    stored: int = Field(description="Each is a new shape.")
    present: int = Field(description="The same bytes were stored under the name already.")
    refused: int = Field(description="Each has its cause.")


class Job(BaseModel):
    """A bulk job: an archive whose files are stored, one after another."""

    model_config = ConfigDict(json_schema_extra={"example": JOB})

    id: str
    state: Literal["waiting", "running", "done", "failed", "cancelled"] = Field(
        description="`failed` means that the archive could not be read to its end, or holds too much; "
        "files that are refused do not make a job fail."
    )
    archive: str = Field(description="What the client called the archive.")
    format: str = Field(description="zip, tar, tar.gz, tar.bz2 or tar.xz.")
    bytes: int = Field(description="Size of the archive.")
    tags: list[str] = Field(description="Of every shape that the job stores.")
    metadata: dict[str, JsonValue] = Field(description="Of every shape that the job stores.")
    counts: Counts
    files_per_second: float | None = Field(description="Of late, while the job runs.")
    remaining_seconds: float | None = Field(description="Until the end at that rate, while the job runs.")
    problem: Cause | None = Field(description="Why the job failed, or will have when it ends.")
    created_at: datetime = Field(description="UTC.")
    started_at: datetime | None = Field(description="UTC; when the archive had been listed.")
    ended_at: datetime | None = Field(description="UTC.")

    @classmethod
    def of(cls, progress: Progress) -> "Job":
        """The JSON of a job."""
        job, counts = progress.job, progress.counts
        assert job.state != "arriving"
        return cls(
            id=job.id,
            state=job.state,
            archive=job.archive,
            format=job.format,
            bytes=job.size,
            tags=list(job.tags),
            metadata=dict(job.metadata),
            counts=Counts(
                files=sum(counts.values()),
                waiting=counts.get(None, 0),
                stored=counts.get("stored", 0),
                present=counts.get("present", 0),
                refused=counts.get("refused", 0),
            ),
            files_per_second=None if progress.rate is None else round(progress.rate, 3),
            remaining_seconds=None if progress.remaining is None else round(progress.remaining, 1),
            problem=None if job.cause is None else Cause.of(job.cause),
            created_at=job.created_at,
            started_at=job.started_at,
            ended_at=job.ended_at,
        )

    @property
    def has_ended(self) -> bool:
        """Whether nothing more becomes of it."""
        return self.state in ENDED


class JobPage(BaseModel):
    """Some of the jobs, the latest first."""

    model_config = ConfigDict(
        json_schema_extra={"example": {"jobs": [JOB], "total": 3, "next_cursor": "eyJhZnRlciI6IDUwfQ"}}
    )

    jobs: list[Job]
    total: int = Field(description="How many jobs are kept in all.")
    next_cursor: str | None = Field(description="Give it as `cursor` to go on; null on the last page.")

    @classmethod
    def of(cls, page: JobsPage) -> "JobPage":
        """The JSON of a page."""
        return cls(
            jobs=[Job.of(progress) for progress in page.jobs],
            total=page.total,
            next_cursor=None if page.after is None else write_cursor(page.after),
        )


class JobFile(BaseModel):
    """A file of a job's archive, and what became of it."""

    model_config = ConfigDict(json_schema_extra={"example": FILE})

    place: int = Field(description="Among the archive's files, from 0.")
    path: str = Field(description="Its name in the archive.")
    outcome: Literal["waiting", "stored", "present", "refused", "cancelled"]
    shape_id: str | None = Field(description="The shape that was stored, or was there; it may be gone since.")
    problem: Cause | None = Field(description="Why it was refused.")

    @classmethod
    def of(cls, file: FileRecord, job: JobRecord) -> "JobFile":
        """The JSON of a file."""
        left: Literal["waiting", "cancelled"] = "cancelled" if job.state in ENDED else "waiting"
        return cls(
            place=file.place,
            path=file.path,
            outcome=left if file.outcome is None else file.outcome,
            shape_id=file.shape_id,
            problem=None if file.cause is None else Cause.of(file.cause),
        )


class JobFilePage(BaseModel):
    """Some of the files of a job, in the order of the archive."""

    model_config = ConfigDict(
        json_schema_extra={"example": {"files": [FILE], "total": 195, "next_cursor": "eyJhZnRlciI6IDUwfQ"}}
    )

    files: list[JobFile]
    total: int = Field(description="How many files are meant in all.")
    next_cursor: str | None = Field(description="Give it as `cursor` to go on; null on the last page.")

    @classmethod
    def of(cls, page: FilesPage) -> "JobFilePage":
        """The JSON of a page."""
        return cls(
            files=[JobFile.of(file, page.job) for file in page.files],
            total=page.total,
            next_cursor=None if page.after is None else write_cursor(page.after),
        )
