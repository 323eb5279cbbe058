"""Operations on jobs: receive, list, process, cancel and delete."""

import uuid
from datetime import UTC, datetime, timedelta

from core.io import format_of
from service.collection import CollectionNumber
from service.collections import repository as collections_repository
from service.errors import BusyError
from service.jobs import repository
from service.jobs.archives import archive_format, list_members
from service.jobs.errors import JobNotFoundError
from service.jobs.members import ArchiveFile, ArchiveLimits, ArchiveMember, MemberFault, shown
from service.jobs.records import (
    ARRIVING_LEASE,
    FailureCause,
    FileRecord,
    FilesPage,
    JobRecord,
    JobsPage,
    MemberOutcome,
    NewJob,
    Outcome,
    Progress,
)
from service.jobs.stored_archive import PIECE_BYTES, StoredArchive
from service.settings import Settings
from service.shapes.records import NewShape
from service.storage.database import Database, ReadSession, WriteSession

BATCHES_AT_ONCE = 8
RATE_WINDOW = 30
DETAIL_CHARACTERS = 1000


def limits_of(settings: Settings) -> ArchiveLimits:
    """The limits of archives; a member is limited like an upload."""
    return ArchiveLimits(
        members=settings.max_archive_files,
        member_bytes=settings.max_upload_bytes,
        total_bytes=settings.max_unpacked_bytes,
        ratio=settings.max_unpacked_ratio,
    )


def receive(database: Database, file: ArchiveFile, new: NewJob, most: int) -> JobRecord:
    """Store an archive and its job; when this returns, the job is durable and waits for its turn.

    Each piece is written in its own transaction, so that other writers wait briefly. An incomplete archive is
    deleted.

    Raises
    ------
    CollectionNotFoundError
        The collection was deleted.
    BusyError
        `most` jobs are unfinished.
    """
    receiver = str(uuid.uuid4())
    with database.write() as session:
        if repository.count_open(session) >= most:
            raise BusyError(f"{most} jobs are unfinished; send the archive when one has ended")
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
    """The progress of a job."""
    rate = None
    if job.state == "running" and job.started_at is not None:
        ends = repository.latest_ends(session, job.number, job.started_at, RATE_WINDOW + 1)
        since = job.started_at if len(ends) <= RATE_WINDOW else ends[-1]
        seconds = (datetime.now(UTC) - since).total_seconds()
        rate = min(len(ends), RATE_WINDOW) / seconds if ends and seconds > 0 else None
    return Progress(job, repository.counts(session, job.number), rate)


def get(session: ReadSession, collection: CollectionNumber, job_id: str) -> JobRecord:
    """The job of a collection with an id.

    Raises
    ------
    JobNotFoundError
        The collection has no such job.
    """
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
    """One page of the members of a job, in the order of the archive."""
    job = get(session, collection, job_id)
    # Places begin at 0; a cursor contains the place of the next member.
    found = repository.files(session, job.number, outcome, after=after - 1, limit=limit + 1)
    more = len(found) > limit
    found = found[:limit]
    counts = repository.counts(session, job.number)
    total = sum(counts.values()) if outcome is None else counts.get(outcome, 0)
    return FilesPage(job, found, total, found[-1].place + 1 if more else None)


def cancel(database: Database, collection: CollectionNumber, job_id: str) -> JobRecord:
    """End a job unless it has ended. Its stored shapes stay; no further ones are stored."""
    with database.write() as session:
        job = get(session, collection, job_id)
        ended = repository.end(session, job.number, "cancelled", None, datetime.now(UTC))
        job = get(session, collection, job_id)
    if ended:
        delete_archive(database, job.number)
    return job


def remove(database: Database, collection: CollectionNumber, job_id: str) -> None:
    """Cancel a job and delete its record."""
    job = cancel(database, collection, job_id)
    with database.write() as session:
        repository.remove(session, job.number)


def begin(database: Database, job: JobRecord, limits: ArchiveLimits) -> None:
    """List the members of a waiting job and start it.

    Raises
    ------
    ArchiveTooLargeError
        The archive exceeds the limits.
    """
    listing = list_members(StoredArchive(database, job), job.format, limits)
    members = [_listed(member) for member in listing.members]
    problem = None if listing.problem is None else cause_of(listing.problem)
    with database.write() as session:
        repository.begin(session, job.number, members, problem, datetime.now(UTC))


def shape_of(job: JobRecord, file: FileRecord, data: bytes) -> NewShape:
    """The shape of a member."""
    return NewShape(
        data=data,
        format=format_of(file.name),
        collection=job.collection,
        name=file.name,
        tags=job.tags,
        metadata=job.metadata,
    )


def settle(session: WriteSession, job: JobRecord, file: FileRecord, settled: MemberOutcome) -> bool:
    """Write the outcome of a member; False if the job has ended or another service was first."""
    return repository.settle(session, job.number, file.place, settled, datetime.now(UTC))


def finish(database: Database, job: JobRecord) -> None:
    """End a completely processed job: as failed if its archive is damaged."""
    with database.write() as session:
        if repository.without_outcome(session, job.number):
            return
        failed = get(session, job.collection, job.id).cause is not None
        repository.end(session, job.number, "failed" if failed else "done", None, datetime.now(UTC))


def fail(database: Database, job: JobRecord, cause: FailureCause) -> None:
    """End a job that cannot continue; its stored shapes stay."""
    with database.write() as session:
        repository.end(session, job.number, "failed", cause, datetime.now(UTC))
    delete_archive(database, job.number)


def delete_archive(database: Database, number: int) -> None:
    """Delete the archive of a job, a few pieces per transaction, so that other writers wait briefly."""
    deleted = BATCHES_AT_ONCE
    while deleted == BATCHES_AT_ONCE:
        with database.write(deleting=True) as session:
            deleted = repository.drop_pieces(session, number, BATCHES_AT_ONCE)


def clear(database: Database, keep: timedelta) -> None:
    """Delete archives of ended jobs, incomplete archives, and records of jobs that ended before `keep`."""
    now = datetime.now(UTC)
    with database.read() as session:
        leftovers = repository.with_leftovers(session, now, now - keep)
    for number, all_of_it in leftovers:
        delete_archive(database, number)
        if all_of_it:
            with database.write(deleting=True) as session:
                repository.remove(session, number)


def _listed(member: ArchiveMember) -> FileRecord:
    """The initial record of a member: refused, or without an outcome."""
    if member.fault is None:
        return FileRecord(member.place, member.path, member.name, None, None, None)
    cause = cause_of(member.fault)
    return FileRecord(member.place, member.path, member.name, "refused", None, cause)


def cause_of(fault: MemberFault) -> FailureCause:
    """The record of a fault."""
    return FailureCause(fault.kind, shown(str(fault))[:DETAIL_CHARACTERS])


def format_of_archive(file: ArchiveFile, settings: Settings) -> str:
    """The format of an archive.

    Raises
    ------
    UnknownArchiveError
        The format is not supported.
    """
    return archive_format(file, limits_of(settings))
