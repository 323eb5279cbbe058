"""The SQL of jobs."""

from collections.abc import Iterable, Mapping
from datetime import datetime, timedelta

from sqlalchemy import delete, func, insert, or_, select, update

from service.collection import CollectionNumber
from service.jobs.records import ACTIVE, FailureCause, FileRecord, JobRecord, NewJob, Outcome, State
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import JobFileRow, JobRow

# A lease that ends later was written before the clock was set back. Slow processes write late leases.
LONGEST_LEASE = timedelta(minutes=10)


def add(session: WriteSession, job_id: str, new: NewJob, now: datetime) -> JobRecord:
    """Add a job, which waits for its turn."""
    row = JobRow(
        id=job_id,
        collection_number=new.collection,
        state="waiting",
        archive=new.archive,
        size=new.size,
        tags=list(new.tags),
        meta=dict(new.metadata),
        created_at=now,
    )
    session.add(row)
    session.flush()
    return _record(row)


def by_id(session: ReadSession, collection: CollectionNumber, job_id: str) -> JobRecord | None:
    """Return the job of a collection with an id."""
    query = select(JobRow).where(JobRow.collection_number == collection, JobRow.id == job_id)
    row = session.scalars(query).one_or_none()
    return None if row is None else _record(row)


def page(session: ReadSession, collection: CollectionNumber, *, before: int, limit: int) -> list[JobRecord]:
    """Return the next jobs of a collection before the job with a number, the latest first; 0 is no bound."""
    query = select(JobRow).where(JobRow.collection_number == collection)
    if before:
        query = query.where(JobRow.number < before)
    return [_record(row) for row in session.scalars(query.order_by(JobRow.number.desc()).limit(limit))]


def count(session: ReadSession, collection: CollectionNumber) -> int:
    """Return the number of jobs of a collection."""
    return session.scalar(select(func.count()).where(JobRow.collection_number == collection)) or 0


def active_ids(session: ReadSession) -> set[str]:
    """Return the ids of the unfinished jobs."""
    return set(session.scalars(select(JobRow.id).where(JobRow.state.in_(ACTIVE))))


def counts(session: ReadSession, number: int) -> dict[Outcome | None, int]:
    """Return the numbers of a job's members by outcome."""
    query = select(JobFileRow.outcome, func.count()).where(JobFileRow.job_number == number)
    rows = session.execute(query.group_by(JobFileRow.outcome)).all()
    return {outcome: many for outcome, many in rows}  # type: ignore[misc]  # noqa: C416


def latest_ends(session: ReadSession, number: int, after: datetime, limit: int) -> list[datetime]:
    """Return the latest times at which members were processed, in descending order."""
    query = (
        select(JobFileRow.ended_at)
        .where(JobFileRow.job_number == number, JobFileRow.ended_at > after)
        .order_by(JobFileRow.ended_at.desc())
        .limit(limit)
    )
    return [ended for ended in session.scalars(query) if ended is not None]


def files(
    session: ReadSession, number: int, outcome: Outcome | None, *, start: int, limit: int
) -> list[FileRecord]:
    """Return the next members of a job from a position on, with one outcome or with any."""
    query = select(JobFileRow).where(JobFileRow.job_number == number, JobFileRow.position >= start)
    if outcome is not None:
        query = query.where(JobFileRow.outcome == outcome)
    return [_file(row) for row in session.scalars(query.order_by(JobFileRow.position).limit(limit))]


def without_outcome(session: ReadSession, number: int) -> list[FileRecord]:
    """Return the members of a job that have not been processed."""
    query = select(JobFileRow).where(JobFileRow.job_number == number, JobFileRow.outcome.is_(None))
    return [_file(row) for row in session.scalars(query.order_by(JobFileRow.position))]


def claim(session: WriteSession, runner: str, until: datetime, now: datetime) -> JobRecord | None:
    """Take over the oldest job that no living service runs; return None if there is none."""
    is_over = or_(JobRow.leased_until <= now, JobRow.leased_until > now + LONGEST_LEASE)
    free = or_(JobRow.leased_until.is_(None), is_over, JobRow.runner == runner)
    query = select(JobRow).where(JobRow.state.in_(ACTIVE), free).order_by(JobRow.number).limit(1)
    row = session.scalars(query).one_or_none()
    if row is None:
        return None
    row.runner, row.leased_until = runner, until
    session.flush()
    return _record(row)


def renew(session: WriteSession, number: int, runner: str, until: datetime) -> bool:
    """Renew the lease of a job; return whether this service still runs it."""
    lease = update(JobRow).where(JobRow.number == number, JobRow.runner == runner, JobRow.state.in_(ACTIVE))
    renewed = session.execute(lease.values(leased_until=until).returning(JobRow.number))
    return renewed.one_or_none() is not None


def release(session: WriteSession, runner: str) -> None:
    """Release the jobs of this service to other services."""
    conditions = JobRow.runner == runner, JobRow.state.in_(ACTIVE)
    session.execute(update(JobRow).where(*conditions).values(runner=None, leased_until=None))


def begin(session: WriteSession, number: int, members: Iterable[FileRecord], now: datetime) -> None:
    """Write the members of a waiting job and start it; nothing happens if it no longer waits."""
    waiting = update(JobRow).where(JobRow.number == number, JobRow.state == "waiting")
    begun = session.execute(waiting.values(state="running", started_at=now).returning(JobRow.number))
    if begun.one_or_none() is None:
        return
    rows = [
        {
            "job_number": number,
            "position": member.position,
            "path": member.path,
            "name": member.name,
            "outcome": member.outcome,
            "ended_at": None if member.outcome is None else now,
            **_cause_values(member.cause),
        }
        for member in members
    ]
    if rows:
        session.execute(insert(JobFileRow), rows)


def settle(
    session: WriteSession,
    number: int,
    position: int,
    outcome: Outcome,
    now: datetime,
    *,
    shape_id: str | None = None,
    cause: FailureCause | None = None,
) -> bool:
    """Write the outcome of a member; return whether the job still runs and the member had none."""
    if session.scalar(select(JobRow.state).where(JobRow.number == number)) != "running":
        return False
    done = session.execute(
        update(JobFileRow)
        .where(JobFileRow.job_number == number, JobFileRow.position == position, JobFileRow.outcome.is_(None))
        .values(outcome=outcome, shape_id=shape_id, ended_at=now, **_cause_values(cause))
        .returning(JobFileRow.position)
    )
    return done.one_or_none() is not None


def end(session: WriteSession, number: int, state: State, cause: FailureCause | None, now: datetime) -> None:
    """End a job, unless it has ended."""
    ended = {"state": state, "ended_at": now, "runner": None, "leased_until": None, **_cause_values(cause)}
    session.execute(update(JobRow).where(JobRow.number == number, JobRow.state.in_(ACTIVE)).values(ended))


def ended_before(session: ReadSession, moment: datetime) -> list[int]:
    """Return the numbers of the jobs that ended at a time or before."""
    return list(session.scalars(select(JobRow.number).where(JobRow.ended_at <= moment)))


def remove(session: WriteSession, number: int) -> None:
    """Delete a job with its members."""
    session.execute(delete(JobRow).where(JobRow.number == number))


def _cause_values(cause: FailureCause | None) -> Mapping[str, str | None]:
    return {"kind": None, "detail": None} if cause is None else {"kind": cause.kind, "detail": cause.detail}


def _cause(row: JobRow | JobFileRow) -> FailureCause | None:
    return None if row.kind is None else FailureCause(row.kind, row.detail or "")


def _record(row: JobRow) -> JobRecord:
    return JobRecord(
        collection=CollectionNumber(row.collection_number),
        archive=row.archive,
        size=row.size,
        tags=tuple(row.tags),
        metadata=row.meta,
        number=row.number,
        id=row.id,
        state=row.state,  # type: ignore[arg-type]
        cause=_cause(row),
        created_at=row.created_at,
        started_at=row.started_at,
        ended_at=row.ended_at,
    )


def _file(row: JobFileRow) -> FileRecord:
    outcome: Outcome | None = row.outcome  # type: ignore[assignment]
    return FileRecord(row.position, row.path, row.name, outcome, row.shape_id, _cause(row))
