"""The SQL of jobs."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import delete, func, or_, select, update

from service.collection import CollectionNumber
from service.jobs.schemas import Outcome, State
from service.jobs.zip_archive import ArchiveMember, MemberFault, shown
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import JobFileRow, JobRow

# Without renewal for this long, a service counts as dead and others may run its jobs.
LEASE = timedelta(seconds=10)
# A lease that ends later was written before the clock was set back. Slow processes write late leases.
LONGEST_LEASE = timedelta(minutes=10)
DETAIL_CHARACTERS = 1000
_ACTIVE = JobRow.state.in_(("waiting", "running"))


class JobLostError(Exception):
    """The job has ended, or another service runs it."""


def add(
    session: WriteSession, job_id: str, collection: CollectionNumber, values: Mapping[str, Any]
) -> JobRow:
    """Add a job, which waits for its turn."""
    now = datetime.now(UTC)
    row = JobRow(id=job_id, collection_number=collection, state="waiting", created_at=now, **values)
    session.add(row)
    session.flush()
    return row


def by_id(session: ReadSession, collection: CollectionNumber, job_id: str) -> JobRow | None:
    """Return the job of a collection with an id."""
    query = select(JobRow).where(JobRow.collection_number == collection, JobRow.id == job_id)
    return session.scalars(query).one_or_none()


def page(session: ReadSession, collection: CollectionNumber, *, before: int, limit: int) -> Sequence[JobRow]:
    """Return the next jobs of a collection before the job with a number, the latest first; 0 is no bound."""
    query = select(JobRow).where(JobRow.collection_number == collection)
    if before:
        query = query.where(JobRow.number < before)
    return session.scalars(query.order_by(JobRow.number.desc()).limit(limit)).all()


def count(session: ReadSession, collection: CollectionNumber) -> int:
    """Return the number of jobs of a collection."""
    return session.scalar(select(func.count()).where(JobRow.collection_number == collection)) or 0


def active(session: ReadSession) -> dict[str, str]:
    """Return the client of each unfinished job by the id of the job."""
    query = select(JobRow.id, JobRow.client).where(_ACTIVE)
    return {job_id: client for job_id, client in session.execute(query)}  # noqa: C416


def counts(session: ReadSession, number: int) -> dict[str | None, int]:
    """Return the numbers of a job's members by outcome; those without one under None."""
    query = select(JobFileRow.outcome, func.count()).where(JobFileRow.job_number == number)
    return {outcome: many for outcome, many in session.execute(query.group_by(JobFileRow.outcome))}  # noqa: C416


def count_refused(session: ReadSession, number: int, kind: str) -> int:
    """Return the number of a job's members that were refused for a reason."""
    refused = JobFileRow.job_number == number, JobFileRow.outcome == "refused", JobFileRow.kind == kind
    return session.scalar(select(func.count()).where(*refused)) or 0


def latest_ends(session: ReadSession, number: int, after: datetime, limit: int) -> list[datetime]:
    """Return the latest times at which members were processed, in descending order."""
    query = select(JobFileRow.ended_at).where(JobFileRow.job_number == number, JobFileRow.ended_at > after)
    ends = session.scalars(query.order_by(JobFileRow.ended_at.desc()).limit(limit))
    return [end for end in ends if end is not None]


def files(
    session: ReadSession, number: int, outcome: Outcome | None, *, start: int, limit: int
) -> Sequence[JobFileRow]:
    """Return the next members of a job from a position on, with one outcome or with any."""
    query = select(JobFileRow).where(JobFileRow.job_number == number, JobFileRow.position >= start)
    if outcome is not None:
        query = query.where(JobFileRow.outcome == outcome)
    return session.scalars(query.order_by(JobFileRow.position).limit(limit)).all()


def without_outcome(session: ReadSession, number: int) -> Sequence[JobFileRow]:
    """Return the members of a job that have not been processed."""
    query = select(JobFileRow).where(JobFileRow.job_number == number, JobFileRow.outcome.is_(None))
    return session.scalars(query.order_by(JobFileRow.position)).all()


def claim(session: WriteSession, runner: str, besides: Collection[str]) -> JobRow | None:
    """Take over the oldest job that no living service runs, `besides` those of some clients; or None."""
    now = datetime.now(UTC)
    is_over = or_(JobRow.leased_until <= now, JobRow.leased_until > now + LONGEST_LEASE)
    free = or_(JobRow.leased_until.is_(None), is_over, JobRow.runner == runner)
    others = JobRow.client.not_in(besides)
    query = select(JobRow).where(_ACTIVE, free, others).order_by(JobRow.number).limit(1)
    row = session.scalars(query).one_or_none()
    if row is not None:
        row.runner, row.leased_until = runner, now + LEASE
    return row


def renew(session: WriteSession, number: int, runner: str) -> None:
    """Renew the lease of a job; raise JobLostError if the job has ended, or another service runs it."""
    lease = update(JobRow).where(JobRow.number == number, JobRow.runner == runner, _ACTIVE)
    values = {"leased_until": datetime.now(UTC) + LEASE}
    if session.execute(lease.values(values).returning(JobRow.number)).one_or_none() is None:
        raise JobLostError


def release(session: WriteSession, runner: str) -> None:
    """Release the jobs of this service to other services."""
    session.execute(
        update(JobRow).where(JobRow.runner == runner, _ACTIVE).values(runner=None, leased_until=None)
    )


def begin(session: WriteSession, number: int, members: Iterable[ArchiveMember]) -> None:
    """Write the members of a waiting job and start it; nothing happens if it is not waiting."""
    now = datetime.now(UTC)
    waiting = update(JobRow).where(JobRow.number == number, JobRow.state == "waiting")
    begun = session.execute(waiting.values(state="running", started_at=now).returning(JobRow.number))
    if begun.one_or_none() is None:
        return
    for position, member in enumerate(members):
        refusal = (
            {} if member.fault is None else {"outcome": "refused", "ended_at": now, **_cause(member.fault)}
        )
        key = {"job_number": number, "position": position, "path": member.path, "name": member.name}
        session.add(JobFileRow(**key, **refusal))


def settle(
    session: WriteSession,
    file: JobFileRow,
    outcome: Outcome,
    *,
    shape_id: str | None = None,
    fault: MemberFault | None = None,
) -> None:
    """Write the outcome of a member.

    Raise JobLostError if the job does not run, or the member has an outcome.
    """
    state = session.scalar(select(JobRow.state).where(JobRow.number == file.job_number))
    key = JobFileRow.job_number == file.job_number, JobFileRow.position == file.position
    values = {"outcome": outcome, "shape_id": shape_id, "ended_at": datetime.now(UTC), **_cause(fault)}
    unsettled = update(JobFileRow).where(*key, JobFileRow.outcome.is_(None)).values(values)
    if state != "running" or not session.scalars(unsettled.returning(JobFileRow.job_number)).all():
        raise JobLostError


def end(session: WriteSession, number: int, state: State, fault: MemberFault | None = None) -> None:
    """End a job, unless it has ended."""
    now = datetime.now(UTC)
    ended = {"state": state, "ended_at": now, "runner": None, "leased_until": None, **_cause(fault)}
    session.execute(update(JobRow).where(JobRow.number == number, _ACTIVE).values(ended))


def ended_before(session: ReadSession, moment: datetime) -> Sequence[int]:
    """Return the numbers of the jobs that ended at a time or before."""
    return session.scalars(select(JobRow.number).where(JobRow.ended_at <= moment)).all()


def remove(session: WriteSession, number: int) -> None:
    """Delete a job with its members."""
    session.execute(delete(JobRow).where(JobRow.number == number))


def _cause(fault: MemberFault | None) -> dict[str, str]:
    return {} if fault is None else {"kind": fault.kind, "detail": shown(str(fault))[:DETAIL_CHARACTERS]}
