"""The SQL of jobs."""

import uuid
from collections.abc import Iterable, Mapping
from datetime import datetime

from sqlalchemy import ColumnElement, Select, delete, func, insert, or_, select, update

from service.collection import CollectionNumber
from service.jobs.records import (
    LONGEST_LEASE,
    FailureCause,
    FileRecord,
    JobRecord,
    MemberOutcome,
    NewJob,
    Outcome,
)
from service.storage.checksums import checksum_of
from service.storage.database import ReadSession, WriteSession
from service.storage.job_states import ACTIVE, ENDED, State
from service.storage.tables import JobFileRow, JobPieceRow, JobRow

ARRIVING: State = "arriving"


def add(session: WriteSession, new: NewJob, runner: str, until: datetime, now: datetime) -> int:
    """Add a job whose archive is being received; its number."""
    row = JobRow(
        id=str(uuid.uuid4()),
        collection_number=new.collection,
        state=ARRIVING,
        archive=new.archive,
        format=new.format,
        size=new.size,
        tags=list(new.tags),
        meta=dict(new.metadata),
        runner=runner,
        leased_until=until,
        created_at=now,
    )
    session.add(row)
    session.flush()
    return row.number


def add_piece(session: WriteSession, number: int, place: int, data: bytes, until: datetime) -> None:
    """Store the next piece of an archive that is being received."""
    session.add(JobPieceRow(job_number=number, position=place, data=data, checksum=checksum_of(data)))
    session.execute(update(JobRow).where(JobRow.number == number).values(leased_until=until))


def acknowledge(session: WriteSession, number: int) -> None:
    """Mark an archive as complete, which makes the job visible."""
    session.execute(
        update(JobRow).where(JobRow.number == number).values(state="waiting", runner=None, leased_until=None)
    )


def piece(session: ReadSession, number: int, place: int) -> bytes | None:
    """A piece of a job's archive; None if the job or its archive was deleted."""
    return session.scalar(
        select(JobPieceRow.data).where(JobPieceRow.job_number == number, JobPieceRow.position == place)
    )


def by_id(session: ReadSession, collection: CollectionNumber, job_id: str) -> JobRecord | None:
    """The job with this id in this collection."""
    row = session.scalars(_shown(collection).where(JobRow.id == job_id)).one_or_none()
    return None if row is None else _record(row)


def by_number(session: ReadSession, number: int) -> JobRecord:
    """The job with a number, which must exist."""
    return _record(session.scalars(select(JobRow).where(JobRow.number == number)).one())


def page(session: ReadSession, collection: CollectionNumber, *, before: int, limit: int) -> list[JobRecord]:
    """The next jobs of a collection before the one with a number, the latest first; 0 is no bound."""
    query = _shown(collection).order_by(JobRow.number.desc()).limit(limit)
    if before:
        query = query.where(JobRow.number < before)
    return [_record(row) for row in session.scalars(query)]


def count(session: ReadSession, collection: CollectionNumber) -> int:
    """The number of jobs of a collection."""
    return session.scalar(select(func.count()).select_from(_shown(collection).subquery())) or 0


def count_open(session: ReadSession) -> int:
    """The number of unfinished jobs, including those whose archives are being received."""
    return session.scalar(select(func.count()).where(JobRow.state.not_in(ENDED))) or 0


def counts(session: ReadSession, number: int) -> dict[Outcome | None, int]:
    """The numbers of a job's members by outcome."""
    query = select(JobFileRow.outcome, func.count()).where(JobFileRow.job_number == number)
    found = session.execute(query.group_by(JobFileRow.outcome)).all()
    return {outcome: many for outcome, many in found}  # type: ignore[misc]  # noqa: C416


def latest_ends(session: ReadSession, number: int, after: datetime, limit: int) -> list[datetime]:
    """The latest times at which members were processed, in descending order."""
    query = (
        select(JobFileRow.ended_at)
        .where(JobFileRow.job_number == number, JobFileRow.ended_at > after)
        .order_by(JobFileRow.ended_at.desc())
        .limit(limit)
    )
    return [ended for ended in session.scalars(query) if ended is not None]


def files(
    session: ReadSession, number: int, outcome: Outcome | None, *, after: int, limit: int
) -> list[FileRecord]:
    """The next members of a job after a place, with one outcome or with any."""
    query = select(JobFileRow).where(JobFileRow.job_number == number, JobFileRow.position > after)
    if outcome is not None:
        query = query.where(JobFileRow.outcome == outcome)
    return [_file(row) for row in session.scalars(query.order_by(JobFileRow.position).limit(limit))]


def without_outcome(session: ReadSession, number: int) -> list[FileRecord]:
    """The members of a job that have not been processed."""
    query = select(JobFileRow).where(JobFileRow.job_number == number, JobFileRow.outcome.is_(None))
    return [_file(row) for row in session.scalars(query.order_by(JobFileRow.position))]


def claim(session: WriteSession, runner: str, until: datetime, now: datetime) -> JobRecord | None:
    """Take over the oldest job that no living service runs; None if there is none."""
    free = or_(JobRow.leased_until.is_(None), _is_over(now), JobRow.runner == runner)
    query = select(JobRow).where(JobRow.state.in_(ACTIVE), free).order_by(JobRow.number).limit(1)
    row = session.scalars(query).one_or_none()
    if row is None:
        return None
    taken = session.execute(
        update(JobRow)
        .where(JobRow.number == row.number, JobRow.state.in_(ACTIVE), free)
        .values(runner=runner, leased_until=until)
        .returning(JobRow.number)
    )
    return None if taken.one_or_none() is None else _record(row)


def renew(session: WriteSession, number: int, runner: str, until: datetime) -> bool:
    """Renew the lease of a job; whether this service still runs it."""
    renewed = session.execute(
        update(JobRow)
        .where(JobRow.number == number, JobRow.runner == runner, JobRow.state.in_(ACTIVE))
        .values(leased_until=until)
        .returning(JobRow.number)
    )
    return renewed.one_or_none() is not None


def release(session: WriteSession, runner: str) -> None:
    """Release the jobs of this service to other services."""
    session.execute(
        update(JobRow)
        .where(JobRow.runner == runner, JobRow.state.in_(ACTIVE))
        .values(runner=None, leased_until=None)
    )


def begin(
    session: WriteSession,
    number: int,
    members: Iterable[FileRecord],
    cause: FailureCause | None,
    now: datetime,
) -> None:
    """Write the members of a waiting job and start it; nothing happens if it no longer waits."""
    begun = session.execute(
        update(JobRow)
        .where(JobRow.number == number, JobRow.state == "waiting")
        .values(state="running", started_at=now, **_cause_values(cause))
        .returning(JobRow.number)
    )
    if begun.one_or_none() is None:
        return
    rows = [
        {
            "job_number": number,
            "position": member.place,
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


def settle(session: WriteSession, number: int, place: int, settled: MemberOutcome, now: datetime) -> bool:
    """Write the outcome of a member; whether the job still runs and the member had none."""
    state = session.scalar(select(JobRow.state).where(JobRow.number == number))
    if state != "running":
        return False
    done = session.execute(
        update(JobFileRow)
        .where(JobFileRow.job_number == number, JobFileRow.position == place, JobFileRow.outcome.is_(None))
        .values(
            outcome=settled.outcome, shape_id=settled.shape_id, ended_at=now, **_cause_values(settled.cause)
        )
        .returning(JobFileRow.position)
    )
    return done.one_or_none() is not None


def end(session: WriteSession, number: int, state: State, cause: FailureCause | None, now: datetime) -> bool:
    """End a job; whether it had not ended."""
    ended = session.execute(
        update(JobRow)
        .where(JobRow.number == number, JobRow.state.in_(ACTIVE))
        .values(
            state=state,
            ended_at=now,
            runner=None,
            leased_until=None,
            **({} if cause is None else _cause_values(cause)),
        )
        .returning(JobRow.number)
    )
    return ended.one_or_none() is not None


def with_leftovers(session: ReadSession, now: datetime, forget_before: datetime) -> list[tuple[int, bool]]:
    """The numbers of jobs with data to delete, each with whether the whole job is to be deleted.

    These are archives of ended jobs, records of jobs that ended long ago, and incompletely received archives.
    """
    gone = (JobRow.state == ARRIVING) & _is_over(now) | (JobRow.ended_at <= forget_before)
    archived = (
        JobRow.state.in_(ENDED)
        & select(JobPieceRow.position).where(JobPieceRow.job_number == JobRow.number).exists()
    )
    query = select(JobRow.number, gone).where(or_(gone, archived)).order_by(JobRow.number)
    return [(number, bool(all_of_it)) for number, all_of_it in session.execute(query)]


def drop_pieces(session: WriteSession, number: int, limit: int) -> int:
    """Delete at most `limit` pieces of a job's archive; how many."""
    query = select(JobPieceRow.position).where(JobPieceRow.job_number == number).limit(limit)
    places = session.scalars(query).all()
    session.execute(
        delete(JobPieceRow).where(JobPieceRow.job_number == number, JobPieceRow.position.in_(places))
    )
    return len(places)


def remove(session: WriteSession, number: int) -> None:
    """Delete a job with its members and its archive."""
    session.execute(delete(JobRow).where(JobRow.number == number))


def _is_over(now: datetime) -> ColumnElement[bool]:
    """Whether a lease has ended. A lease beyond the longest was written before the clock was set back."""
    return or_(JobRow.leased_until <= now, JobRow.leased_until > now + LONGEST_LEASE)


def _shown(collection: CollectionNumber) -> Select[JobRow]:
    return select(JobRow).where(JobRow.collection_number == collection, JobRow.state != ARRIVING)


def _cause_values(cause: FailureCause | None) -> Mapping[str, str | None]:
    return {"kind": None, "detail": None} if cause is None else {"kind": cause.kind, "detail": cause.detail}


def _cause(row: JobRow | JobFileRow) -> FailureCause | None:
    return None if row.kind is None else FailureCause(row.kind, row.detail or "")


def _record(row: JobRow) -> JobRecord:
    return JobRecord(
        number=row.number,
        id=row.id,
        collection=CollectionNumber(row.collection_number),
        state=row.state,  # type: ignore[arg-type]
        archive=row.archive,
        format=row.format,
        size=row.size,
        tags=tuple(row.tags),
        metadata=row.meta,
        cause=_cause(row),
        created_at=row.created_at,
        started_at=row.started_at,
        ended_at=row.ended_at,
    )


def _file(row: JobFileRow) -> FileRecord:
    return FileRecord(
        place=row.position,
        path=row.path,
        name=row.name,
        outcome=row.outcome,  # type: ignore[arg-type]
        shape_id=row.shape_id,
        cause=_cause(row),
    )
