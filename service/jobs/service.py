"""Operations on jobs: receive, list, process, cancel and delete.

The archive of an unfinished job is a file of a folder, named by the id of the job.
"""

import errno
import os
import shutil
import time
import uuid
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import BinaryIO

from core.io import format_of
from service.collection import CollectionNumber
from service.collections import repository as collections_repository
from service.errors import (
    ArchiveError,
    BusyError,
    ServiceError,
    StorageFullError,
    StorageUnavailableError,
)
from service.jobs import repository
from service.jobs.records import FailureCause, FileRecord, JobRecord, NewJob, Outcome, Progress
from service.jobs.zip_archive import (
    ArchiveLimits,
    ArchiveMember,
    MalformedArchiveError,
    MemberError,
    MemberFault,
    list_members,
    read_members,
    shown,
)
from service.settings import Settings
from service.shapes.listing import Page, write_cursor
from service.shapes.records import NewShape
from service.storage.archive_file import put_in_place
from service.storage.database import Database, ReadSession
from service.storage.sqlite import path_of

RATE_WINDOW = 30
DETAIL_CHARACTERS = 1000

# A file without a job may belong to a job that is being stored now.
ORPHAN_SECONDS = 3600.0
_ARCHIVES = "????????-????-????-????-????????????.*"


class JobNotFoundError(ServiceError, kind="job-not-found"):
    """No job has the id, or its record was deleted."""

    def __init__(self, job_id: str) -> None:
        super().__init__(f"there is no job {job_id!r}")


def limits_of(settings: Settings) -> ArchiveLimits:
    """Return the limits of archives; a member is limited like an upload."""
    return ArchiveLimits(
        members=settings.max_archive_files,
        member_bytes=settings.max_upload_bytes,
        total_bytes=settings.max_unpacked_bytes,
        ratio=settings.max_unpacked_ratio,
    )


def folder_of(settings: Settings) -> Path:
    """Return the folder of archives: that of the settings, or one beside the SQLite file."""
    if settings.job_folder:
        return Path(settings.job_folder)
    try:
        path = path_of(settings.database_url)
    except ArchiveError:
        return Path("isoshape-data/jobs")
    return path.with_name(f"{path.name}-jobs")


def receive(database: Database, folder: Path, file: BinaryIO, new: NewJob, most: int) -> JobRecord:
    """Store an archive and its job; when this returns, both are durable and the job waits for its turn.

    Stages: check that the job is accepted; copy the archive into the folder; insert the job.

    Raises
    ------
    CollectionNotFoundError
        The collection was deleted.
    BusyError
        `most` jobs are unfinished.
    StorageFullError, StorageUnavailableError
        The archive cannot be written.
    """
    with database.read() as session:
        _check_room(session, most)
    job_id = str(uuid.uuid4())
    path = archive_path(folder, job_id)
    try:
        _copy(file, path)
        with database.write() as session:
            _check_room(session, most)
            collections_repository.require(session, new.collection)
            return repository.add(session, job_id, new, datetime.now(UTC))
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def archive_path(folder: Path, job_id: str) -> Path:
    """Return the file of a job's archive."""
    return folder / f"{job_id}.zip"


def progress(session: ReadSession, job: JobRecord) -> Progress:
    """Return the progress of a job."""
    rate = None
    if job.state == "running" and job.started_at is not None:
        ends = repository.latest_ends(session, job.number, job.started_at, RATE_WINDOW + 1)
        since = job.started_at if len(ends) <= RATE_WINDOW else ends[-1]
        seconds = (datetime.now(UTC) - since).total_seconds()
        rate = min(len(ends), RATE_WINDOW) / seconds if ends and seconds > 0 else None
    return Progress(job, repository.counts(session, job.number), rate)


def get(session: ReadSession, collection: CollectionNumber, job_id: str) -> JobRecord:
    """Return the job of a collection with an id.

    Raises
    ------
    JobNotFoundError
        The collection has no such job.
    """
    job = repository.by_id(session, collection, job_id)
    if job is None:
        raise JobNotFoundError(job_id)
    return job


def list_page(
    session: ReadSession, collection: CollectionNumber, *, before: int, limit: int
) -> Page[Progress]:
    """Return one page of a collection's jobs, the latest first."""
    jobs = repository.page(session, collection, before=before, limit=limit + 1)
    next_cursor = write_cursor(jobs[limit - 1].number) if len(jobs) > limit else None
    total = repository.count(session, collection)
    return Page([progress(session, job) for job in jobs[:limit]], total, next_cursor)


def list_files(
    session: ReadSession, job: JobRecord, outcome: Outcome | None, *, start: int, limit: int
) -> Page[FileRecord]:
    """Return one page of the members of a job from a position on, in the order of the archive."""
    files = repository.files(session, job.number, outcome, start=start, limit=limit + 1)
    counts = repository.counts(session, job.number)
    total = sum(counts.values()) if outcome is None else counts.get(outcome, 0)
    next_cursor = write_cursor(files[limit].position) if len(files) > limit else None
    return Page(files[:limit], total, next_cursor)


def cancel(database: Database, folder: Path, collection: CollectionNumber, job_id: str) -> JobRecord:
    """End a job unless it has ended. Its stored shapes stay; no further shapes are stored."""
    with database.write() as session:
        job = get(session, collection, job_id)
        repository.end(session, job.number, "cancelled", job.cause, datetime.now(UTC))
    delete_archive(folder, job)
    return job


def remove(database: Database, folder: Path, collection: CollectionNumber, job_id: str) -> None:
    """Cancel a job and delete its record."""
    job = cancel(database, folder, collection, job_id)
    with database.write() as session:
        repository.remove(session, job.number)


def begin(database: Database, folder: Path, job: JobRecord, limits: ArchiveLimits) -> None:
    """List the members of a waiting job and start it.

    Raises
    ------
    ArchiveTooLargeError
        The archive exceeds the limits.
    MalformedArchiveError
        The archive cannot be read, or is not in the folder.
    """
    with _open(folder, job) as archive:
        members = [_listed(member) for member in list_members(archive, limits)]
    with database.write() as session:
        repository.begin(session, job.number, members, datetime.now(UTC))


def unprocessed(
    folder: Path, job: JobRecord, files: list[FileRecord], limits: ArchiveLimits
) -> Iterator[tuple[FileRecord, bytes | MemberFault]]:
    """Yield members of a job, each with its bytes or the reason of refusal.

    Raises
    ------
    ArchiveTooLargeError, MalformedArchiveError
        As `begin`.
    """
    unread = {file.position: file for file in files}
    with _open(folder, job) as archive:
        for position, data in read_members(archive, limits, frozenset(unread)):
            yield unread.pop(position), data
    for file in unread.values():
        yield file, MemberError("member-damaged", "the archive is damaged before this file")


def shape_of(job: JobRecord, file: FileRecord, data: bytes) -> NewShape:
    """Return the shape of a member."""
    return NewShape(data, format_of(file.name), job.collection, file.name, job.tags, job.metadata)


def finish(database: Database, folder: Path, job: JobRecord) -> None:
    """End a job, if all its members are processed."""
    with database.write() as session:
        if repository.without_outcome(session, job.number):
            return
        repository.end(session, job.number, "done", None, datetime.now(UTC))
    delete_archive(folder, job)


def fail(database: Database, folder: Path, job: JobRecord, cause: FailureCause) -> None:
    """End a job that cannot continue; its stored shapes stay."""
    with database.write() as session:
        repository.end(session, job.number, "failed", cause, datetime.now(UTC))
    delete_archive(folder, job)


def delete_archive(folder: Path, job: JobRecord) -> None:
    """Delete the archive of a job that has ended."""
    archive_path(folder, job.id).unlink(missing_ok=True)


def clear(database: Database, folder: Path, keep: timedelta) -> bool:
    """Delete records of jobs that ended before `keep`, and files of no job.

    Returns
    -------
    bool
        Whether a job is unfinished.
    """
    with database.read() as session:
        active = repository.active_ids(session)
        gone = repository.ended_before(session, datetime.now(UTC) - keep)
    for number in gone:
        with database.write(deleting=True) as session:
            repository.remove(session, number)
    for path in folder.glob(_ARCHIVES):
        # Another service may delete the file meanwhile.
        with suppress(OSError):
            if path.stem not in active and path.stat().st_mtime < time.time() - ORPHAN_SECONDS:
                path.unlink()
    return bool(active)


def cause_of(fault: MemberFault) -> FailureCause:
    """Return the record of a fault."""
    return FailureCause(fault.kind, shown(str(fault))[:DETAIL_CHARACTERS])


def _check_room(session: ReadSession, most: int) -> None:
    if len(repository.active_ids(session)) >= most:
        raise BusyError(f"{most} jobs are unfinished; send the archive when one has ended")


def _copy(file: BinaryIO, path: Path) -> None:
    """Copy an archive into its folder, durably and under its name only when it is complete."""
    partial = path.with_suffix(".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file.seek(0)
        with partial.open("xb") as copy:
            os.fchmod(copy.fileno(), 0o600)
            shutil.copyfileobj(file, copy, 1024 * 1024)
        put_in_place(partial, path)
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT}:
            raise StorageFullError("the folder of the jobs' archives is full") from error
        raise StorageUnavailableError(f"the archive cannot be written: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)


def _open(folder: Path, job: JobRecord) -> BinaryIO:
    try:
        return archive_path(folder, job.id).open("rb")
    except FileNotFoundError as error:
        raise MalformedArchiveError(
            "the archive is not in the folder of this service (ISOSHAPE_JOB_FOLDER); send it again"
        ) from error


def _listed(member: ArchiveMember) -> FileRecord:
    """Return the initial record of a member: refused, or without an outcome."""
    if member.fault is None:
        return FileRecord(member.position, member.path, member.name)
    cause = cause_of(member.fault)
    return FileRecord(member.position, member.path, member.name, "refused", None, cause)
