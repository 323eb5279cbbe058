"""Jobs as they go between storage, service and endpoints."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Literal, get_args

from service.collection import CollectionNumber
from service.storage.job_states import State

Outcome = Literal["stored", "present", "refused"]
"""Of a member: a new shape, the shape that was there, or none."""

OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)


# How long a service that says nothing is taken to live: its jobs are then anybody's.
LEASE = timedelta(seconds=10)
# While an archive arrives.
ARRIVING_LEASE = 6 * LEASE
# No lease ends so much later than now, be it that another process was held up since it asked for the time.
LONGEST_LEASE = timedelta(minutes=10)


@dataclass(frozen=True)
class Cause:
    """A kind of problem, and what happened this time."""

    kind: str
    detail: str


@dataclass(frozen=True)
class NewJob:
    """An archive to be received, for which collection, and what is written about every shape in it."""

    collection: CollectionNumber
    archive: str
    format: str
    size: int
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]


@dataclass(frozen=True)
class JobRecord:
    """A job. Its `number` orders jobs and stays inside the service; `cause` is why it failed."""

    number: int
    id: str
    collection: CollectionNumber
    state: State
    archive: str
    format: str
    size: int
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]
    cause: Cause | None
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None


@dataclass(frozen=True)
class FileRecord:
    """A member and its outcome, none yet or never; `cause` is why it was refused."""

    place: int
    path: str
    name: str
    outcome: Outcome | None
    shape_id: str | None
    cause: Cause | None


@dataclass(frozen=True)
class Settled:
    """What became of a member."""

    outcome: Outcome
    shape_id: str | None = None
    cause: Cause | None = None


@dataclass(frozen=True)
class Progress:
    """How far a job is.

    Attributes
    ----------
    job : JobRecord
    counts : dict
        Members by outcome; those that have none under None.
    rate : float or None
        Members a second, of late.
    """

    job: JobRecord
    counts: Mapping[Outcome | None, int]
    rate: float | None

    @property
    def remaining(self) -> float | None:
        """Seconds until the end, at this rate."""
        return self.counts.get(None, 0) / self.rate if self.rate and self.job.state == "running" else None


@dataclass(frozen=True)
class JobsPage:
    """Some jobs, how many there are in all, and the number to go on after, if there are more."""

    jobs: list[Progress]
    total: int
    after: int | None


@dataclass(frozen=True)
class FilesPage:
    """Some members of a job, how many there are in all, and the place to go on after, if there are more."""

    job: JobRecord
    files: list[FileRecord]
    total: int
    after: int | None
