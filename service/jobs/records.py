"""Values that describe jobs between storage, service and endpoints."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from service.collection import CollectionNumber

State = Literal["waiting", "running", "done", "failed", "cancelled"]
"""The state of a job."""

ACTIVE: tuple[State, ...] = ("waiting", "running")
ENDED: tuple[State, ...] = ("done", "failed", "cancelled")

Outcome = Literal["stored", "present", "refused"]
"""The outcome of a member: a new shape, an existing shape, or no shape."""


@dataclass(frozen=True)
class FailureCause:
    """The kind of a problem and its description."""

    kind: str
    detail: str


@dataclass(frozen=True)
class NewJob:
    """An archive that was received, its collection, and the tags and metadata of all its shapes."""

    collection: CollectionNumber
    archive: str
    size: int
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]


@dataclass(frozen=True)
class JobRecord(NewJob):
    """A job. `number` orders jobs and is never sent to clients; `cause` tells why the job failed."""

    number: int
    id: str
    state: State
    cause: FailureCause | None
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None


@dataclass(frozen=True)
class FileRecord:
    """A member and its outcome, None until it is processed; `cause` tells why it was refused."""

    position: int
    path: str
    name: str
    outcome: Outcome | None = None
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
