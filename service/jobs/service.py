"""What can be done with jobs."""

import uuid
from datetime import UTC, datetime, timedelta

from core.io import format_of
from service.collection import CollectionNumber
from service.collections import repository as collections_repository
from service.errors import BusyError
from service.jobs import repository
from service.jobs.archives import archive_format, list_members
from service.jobs.errors import JobNotFoundError
from service.jobs.members import ArchiveLimits, Fault, Member, Readable, shown
from service.jobs.records import (
    ARRIVING_LEASE,
    Cause,
    FileRecord,
    FilesPage,
    JobRecord,
    JobsPage,
    NewJob,
    Outcome,
    Progress,
    Settled,
)
from service.jobs.stored_archive import PIECE_BYTES, StoredArchive
from service.settings import Settings
from service.shapes.records import NewShape
from service.storage.database import Database, ReadSession, WriteSession

BATCHES_AT_ONCE = 8
RATE_WINDOW = 30
DETAIL_CHARACTERS = 1000


def limits_of(settings: Settings) -> ArchiveLimits:
    """What an archive may hold; a member no more than an upload."""
    return ArchiveLimits(
        members=settings.max_archive_files,
        member_bytes=settings.max_upload_bytes,
        total_bytes=settings.max_unpacked_bytes,
        ratio=settings.max_unpacked_ratio,
    )


def receive(database: Database, file: Readable, new: NewJob, most: int) -> JobRecord:
    """Store an archive and its job; once this returns, it is durable, and its turn comes.

    It is written piece by piece, so that others write in between; what does not arrive whole is deleted.

    Raises
    ------
    CollectionNotFoundError
        Its collection is there no more.
    BusyError
        `most` jobs have not ended.
    """
    receiver = str(uuid.uuid4())
    with database.write() as session:
        if repository.count_open(session) >= most:
            raise BusyError(f"{most} jobs wait or are at work; send the archive when one has ended")
        collections_repository.require(session, new.collection)
        now = datetime.now(UTC)
        number = repository.add(session, new, receiver, now + ARRIVING_LEASE, now)
    try:
        file.seek(0)
        place = 0
        while data := file.read(PIECE_BYTES):
            with database.write() as session:
                repository.add_piece(session, number, place, data, datetime.now(UTC) + ARRIVING_LEASE)
            place += 1
        with database.write() as session:
            repository.acknowledge(session, number)
            return repository.by_number(session, number)
    except BaseException:
        delete_archive(database, number)
        with database.write() as session:
            repository.remove(session, number)
        raise


def progress(session: ReadSession, job: JobRecord) -> Progress:
    """How far a job is."""
    rate = None
    if job.state == "running" and job.started_at is not None:
        ends = repository.latest_ends(session, job.number, job.started_at, RATE_WINDOW + 1)
        since = job.started_at if len(ends) <= RATE_WINDOW else ends[-1]
        seconds = (datetime.now(UTC) - since).total_seconds()
        rate = min(len(ends), RATE_WINDOW) / seconds if ends and seconds > 0 else None
    return Progress(job, repository.counts(session, job.number), rate)


def get(session: ReadSession, collection: CollectionNumber, job_id: str) -> JobRecord:
    """The job of a collection with an id."""
    job = repository.by_id(session, collection, job_id)
    if job is None:
        raise JobNotFoundError(job_id)
    return job


def list_page(session: ReadSession, collection: CollectionNumber, *, before: int, limit: int) -> JobsPage:
    """One page of a collection's jobs, the latest first."""
    found = repository.page(session, collection, before=before, limit=limit + 1)
    more = len(found) > limit
    found = found[:limit]
    jobs = [progress(session, job) for job in found]
    return JobsPage(jobs, repository.count(session, collection), found[-1].number if more else None)


def list_files(
    session: ReadSession,
    collection: CollectionNumber,
    job_id: str,
    outcome: Outcome | None,
    *,
    after: int,
    limit: int,
) -> FilesPage:
    """One page of the members of a collection's job, in the order of the archive."""
    job = get(session, collection, job_id)
    # The places begin at 0, and a cursor holds what comes next.
    found = repository.files(session, job.number, outcome, after=after - 1, limit=limit + 1)
    more = len(found) > limit
    found = found[:limit]
    counts = repository.counts(session, job.number)
    total = sum(counts.values()) if outcome is None else counts.get(outcome, 0)
    return FilesPage(job, found, total, found[-1].place + 1 if more else None)


def cancel(database: Database, collection: CollectionNumber, job_id: str) -> JobRecord:
    """End a collection's job, unless it has ended; what it has stored stays, and nothing more is stored."""
    with database.write() as session:
        job = get(session, collection, job_id)
        ended = repository.end(session, job.number, "cancelled", None, datetime.now(UTC))
        job = get(session, collection, job_id)
    if ended:
        delete_archive(database, job.number)
    return job


def remove(database: Database, collection: CollectionNumber, job_id: str) -> None:
    """Cancel a collection's job, and forget it."""
    job = cancel(database, collection, job_id)
    with database.write() as session:
        repository.remove(session, job.number)


def begin(database: Database, job: JobRecord, limits: ArchiveLimits) -> None:
    """List the members of a job that waits, which then runs.

    Raises
    ------
    ArchiveTooLargeError
    """
    listing = list_members(StoredArchive(database, job), job.format, limits)
    members = [_listed(member) for member in listing.members]
    problem = None if listing.problem is None else cause_of(listing.problem)
    with database.write() as session:
        repository.begin(session, job.number, members, problem, datetime.now(UTC))


def shape_of(job: JobRecord, file: FileRecord, data: bytes) -> NewShape:
    """The shape that a member is to be."""
    return NewShape(
        data=data,
        format=format_of(file.name),
        collection=job.collection,
        name=file.name,
        tags=job.tags,
        metadata=job.metadata,
    )


def settle(session: WriteSession, job: JobRecord, file: FileRecord, settled: Settled) -> bool:
    """Write down what became of a member; False where the job has ended, or somebody else was first."""
    return repository.settle(session, job.number, file.place, settled, datetime.now(UTC))


def finish(database: Database, job: JobRecord) -> None:
    """End a job of which nothing is left to do: failed, where its archive could not be read to the end."""
    with database.write() as session:
        if repository.without_outcome(session, job.number):
            return
        failed = get(session, job.collection, job.id).cause is not None
        repository.end(session, job.number, "failed" if failed else "done", None, datetime.now(UTC))


def fail(database: Database, job: JobRecord, cause: Cause) -> None:
    """End a job that cannot be gone on with; what it has stored stays."""
    with database.write() as session:
        repository.end(session, job.number, "failed", cause, datetime.now(UTC))
    delete_archive(database, job.number)


def delete_archive(database: Database, number: int) -> None:
    """Delete the pieces of a job's archive, a few at a time, so that others write in between."""
    deleted = BATCHES_AT_ONCE
    while deleted == BATCHES_AT_ONCE:
        with database.write() as session:
            deleted = repository.drop_pieces(session, number, BATCHES_AT_ONCE)


def clear(database: Database, keep: timedelta) -> None:
    """Delete what has been left over, and the records of jobs that ended so long ago."""
    now = datetime.now(UTC)
    with database.read() as session:
        leftovers = repository.with_leftovers(session, now, now - keep)
    for number, all_of_it in leftovers:
        delete_archive(database, number)
        if all_of_it:
            with database.write() as session:
                repository.remove(session, number)


def _listed(member: Member) -> FileRecord:
    """A member as it is written down at first: refused, or without an outcome."""
    if member.fault is None:
        return FileRecord(member.place, member.path, member.name, None, None, None)
    cause = cause_of(member.fault)
    return FileRecord(member.place, member.path, member.name, "refused", None, cause)


def cause_of(fault: Fault) -> Cause:
    """A fault as it is written down."""
    return Cause(fault.kind, shown(str(fault))[:DETAIL_CHARACTERS])


def format_of_archive(file: Readable, settings: Settings) -> str:
    """Which kind of archive a file is.

    Raises
    ------
    UnknownArchiveError
        It is none that is read.
    """
    return archive_format(file, limits_of(settings))
