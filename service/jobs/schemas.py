"""JSON models of bulk jobs."""

from collections.abc import Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from service.http.problem_document import Cause
from service.shapes.schemas import Page

if TYPE_CHECKING:
    from service.storage.tables import JobFileRow, JobRow

State = Literal["waiting", "running", "done", "failed", "cancelled"]
"""The state of a job."""

ENDED: tuple[State, ...] = ("done", "failed", "cancelled")

Outcome = Literal["stored", "present", "refused"]
"""The outcome of a member: a new shape, an existing shape, or no shape."""

JOB: dict[str, Any] = {
    "id": "5d2c8e0a-93ff-4f6b-8a55-7b1f1a2f0d11",
    "state": "running",
    "archive": "parts.zip",
    "bytes": 48211034,
    "tags": ["2026"],
    "metadata": {"source": "scan"},
    "counts": {"files": 195, "waiting": 120, "stored": 70, "present": 2, "refused": 3, "ignored": 1},
    "files_per_second": 2.4,
    "remaining_seconds": 50.0,
    "problem": None,
    "created_at": "2026-01-31T12:00:00Z",
    "started_at": "2026-01-31T12:00:01Z",
    "ended_at": None,
}
FILE: dict[str, Any] = {
    "position": 7,
    "path": "cups/7.off",
    "outcome": "refused",
    "shape_id": None,
    "problem": Cause.of(
        "member-damaged", "it cannot be unpacked: Bad CRC-32 for file 'cups/7.off'"
    ).model_dump(),
}


def _cause_of(row: "JobRow | JobFileRow") -> Cause | None:
    """Return the recorded cause of a failure or a refusal, or None if there is none."""
    return None if row.kind is None else Cause.of(row.kind, row.detail or "")


class Counts(BaseModel):
    """The numbers of files in an archive by outcome, without folders."""

    files: int = Field(description="All files; 0 until the archive has been listed.")
    waiting: int = Field(description="Files without an outcome; if the job has ended, they never get one.")
    stored: int = Field(description="Files that became new shapes.")
    present: int = Field(description="Files that were already stored under their name.")
    refused: int = Field(description="Files that were refused, each with a problem.")
    ignored: int = Field(description="Those of the refused files that are no meshes by their names.")


class Job(BaseModel):
    """A bulk job, which stores the files of an archive one after another."""

    model_config = ConfigDict(json_schema_extra={"example": JOB})

    id: str
    state: State = Field(
        description="`failed` means that the archive cannot be read or exceeds the limits; refused files "
        "alone do not make a job fail."
    )
    archive: str = Field(description="The file name of the archive.")
    bytes: int = Field(description="Size of the archive.")
    tags: list[str] = Field(description="Tags of every shape that the job stores.")
    metadata: dict[str, JsonValue] = Field(description="Metadata of every shape that the job stores.")
    counts: Counts
    files_per_second: float | None = Field(description="Recent speed of a running job.")
    remaining_seconds: float | None = Field(description="Estimated time to the end of a running job.")
    problem: Cause | None = Field(description="The reason why the job failed.")
    created_at: datetime = Field(description="UTC.")
    started_at: datetime | None = Field(description="UTC; the time at which the archive had been listed.")
    ended_at: datetime | None = Field(description="UTC.")

    @classmethod
    def of(cls, job: "JobRow", counts: Mapping[str | None, int], ignored: int, rate: float | None) -> "Job":
        """Return the JSON of a job, its numbers of files by outcome, and its speed in files per second.

        `ignored` of the refused files are no meshes by their names.
        """
        names = ("id", "state", "archive", "tags", "created_at", "started_at", "ended_at")
        numbers = {"waiting": 0, "stored": 0, "present": 0, "refused": 0}
        numbers |= {outcome or "waiting": many for outcome, many in counts.items()}
        values: dict[str, Any] = {name: getattr(job, name) for name in names}
        return cls(
            **values,
            bytes=job.size,
            metadata=job.meta,
            counts=Counts(files=sum(counts.values()), ignored=ignored, **numbers),
            files_per_second=None if rate is None else round(rate, 3),
            remaining_seconds=round(numbers["waiting"] / rate, 1) if rate else None,
            problem=_cause_of(job),
        )

    @property
    def has_ended(self) -> bool:
        """Return whether the job has ended."""
        return self.state in ENDED


class JobPage(Page):
    """A page of jobs, the latest first."""

    jobs: list[Job]


class JobFile(BaseModel):
    """A file of a job's archive and its outcome."""

    model_config = ConfigDict(json_schema_extra={"example": FILE})

    position: int = Field(description="Index among the files of the archive, from 0.")
    path: str = Field(description="Name in the archive.")
    outcome: Literal["waiting", "stored", "present", "refused", "cancelled"]
    shape_id: str | None = Field(description="The new or existing shape; it may have been deleted since.")
    problem: Cause | None = Field(description="The reason of the refusal.")

    @classmethod
    def of(cls, file: "JobFileRow", unprocessed: Literal["waiting", "cancelled"]) -> "JobFile":
        """Return the JSON of a file; `unprocessed` is the outcome of one without an outcome."""
        values: dict[str, Any] = {"outcome": file.outcome or unprocessed, "problem": _cause_of(file)}
        return cls(position=file.position, path=file.path, shape_id=file.shape_id, **values)


class JobFilePage(Page):
    """A page of a job's files, in the order of the archive."""

    files: list[JobFile]
