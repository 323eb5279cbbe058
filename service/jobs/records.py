"""Values that describe jobs between storage, service and endpoints."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Literal

from service.collection import CollectionNumber
from service.storage.job_states import State

Outcome = Literal["stored", "present", "refused"]
"""The outcome of a member: a new shape, an existing shape, or no shape."""


# Without renewal for this long, a service counts as dead and others may run its jobs.
LEASE = timedelta(seconds=10)
# The lease while an archive is received.
ARRIVING_LEASE = 6 * LEASE
# A lease that ends later was written before the clock was set back. Slow processes write late leases.
LONGEST_LEASE = timedelta(minutes=10)


@dataclass(frozen=True)
class FailureCause:
    """The kind of a problem and its description."""

    kind: str
    detail: str


@dataclass(frozen=True)
class NewJob:
    """An archive to receive, its collection, and the tags and metadata of all its shapes."""

    collection: CollectionNumber
    archive: str
    format: str
    size: int
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]


@dataclass(frozen=True)
class JobRecord:
    """A job. `number` orders jobs and is never sent to clients; `cause` tells why the job failed."""

    number: int
    id: str
    collection: CollectionNumber
    state: State
    archive: str
    format: str
    size: int
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]
    cause: FailureCause | None
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None


@dataclass(frozen=True)
class FileRecord:
    """A member and its outcome, None until it is processed; `cause` tells why it was refused."""

    place: int
    path: str
    name: str
    outcome: Outcome | None
    shape_id: str | None
    cause: FailureCause | None


@dataclass(frozen=True)
class MemberOutcome:
    """The outcome of a member, its shape, and the reason if it was refused."""

    outcome: Outcome
    shape_id: str | None = None
    cause: FailureCause | None = None


@dataclass(frozen=True)
class Progress:
    """The progress of a job.

    Attributes
    ----------
    job : JobRecord
    counts : dict
        Number of members by outcome; unprocessed ones under None.
    rate : float or None
        Recent speed, in members per second.
    """

    job: JobRecord
    counts: Mapping[Outcome | None, int]
    rate: float | None

    @property
    def remaining(self) -> float | None:
        """Estimated time to the end, in seconds."""
        return self.counts.get(None, 0) / self.rate if self.rate and self.job.state == "running" else None


@dataclass(frozen=True)
class JobsPage:
    """A page of jobs, the number of all, and the number of its last job if more follow."""

    jobs: list[Progress]
    total: int
    after: int | None


@dataclass(frozen=True)
class FilesPage:
    """A page of members, the number of all, and the place of its last member if more follow."""

    job: JobRecord
    files: list[FileRecord]
    total: int
    after: int | None
