"""Operations on jobs: receive, list, process, cancel and delete.

The archive of an unfinished job is a file of a folder, named by the id of the job.
"""

import os
import shutil
import time
import uuid
from collections import Counter
from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, BinaryIO

from core.errors import UnknownFormatError
from service.collection import CollectionNumber
from service.collections import repository as collections_repository
from service.errors import ArchiveError, BusyError, MissingError, ServiceError
from service.jobs import repository
from service.jobs.schemas import ENDED, Job, JobFile, JobFilePage, JobPage, Outcome, State
from service.jobs.zip_archive import (
    MalformedArchiveError,
    MemberError,
    MemberFault,
    ReadDirectory,
    ZipArchive,
)
from service.settings import Settings
from service.shapes.schemas import write_cursor
from service.storage.database import Database, ReadSession
from service.storage.files import disk_errors, make_folder, put_in_place
from service.storage.sqlite import path_of
from service.storage.tables import JobFileRow, JobRow

# The number of files by which the speed of a job is measured.
RATE_WINDOW = 30
# A file without a job may belong to a job that is being stored now.
ORPHAN_SECONDS = 3600.0
_ARCHIVES = "????????-????-????-????-????????????.*"


class JobNotFoundError(MissingError, kind="job-not-found"):
    """No job has the id, or its record was deleted."""


def folder_of(settings: Settings) -> Path:
    """Return the folder of archives: that of the settings, or one beside the SQLite file."""
    if settings.job_folder:
        return Path(settings.job_folder)
    try:
        path = path_of(settings.database_url)
    except ArchiveError:
        return Path("isoshape-data/jobs")
    return path.with_name(f"{path.name}-jobs")


class Jobs:
    """The jobs of a database, and the files of their archives.

    Methods that take the id of a job raise JobNotFoundError if the collection has no such job. Methods that
    take a row are for the service that runs the job.
    """

    def __init__(self, database: Database, settings: Settings) -> None:
        self._database = database
        self._settings = settings
        self._folder = folder_of(settings)

    def receive(
        self,
        file: BinaryIO,
        client: str,
        collection: CollectionNumber,
        archive: str,
        tags: Sequence[str],
        metadata: Mapping[str, Any],
    ) -> Job:
        """Store an archive and its job; when this returns, both are durable and the job waits for its turn.

        Raise CollectionNotFoundError if the collection was deleted, BusyError if the largest number of jobs
        is unfinished, or the client has its share of them, and StorageFullError or StorageUnavailableError if
        the archive cannot be written.
        """
        with self._database.read() as session:
            self._check_room(session, client)
        job_id = str(uuid.uuid4())
        path = self.archive_path(job_id)
        try:
            with disk_errors("the archive cannot be written"):
                size = _copy(file, path)
            with self._database.write() as session:
                self._check_room(session, client)
                collections_repository.require(session, collection)
                values = {"client": client, "archive": archive, "size": size}
                values |= {"tags": list(tags), "meta": dict(metadata)}
                job = repository.add(session, job_id, collection, values)
                return _shown(session, job)
        except BaseException:
            # An error at the end of a transaction does not tell whether the job was stored.
            self._remove_unless_active(job_id)
            raise

    def archive_path(self, job_id: str) -> Path:
        """Return the file of a job's archive."""
        return self._folder / f"{job_id}.zip"

    def read(self, collection: CollectionNumber, job_id: str) -> Job:
        """Return the current state of a job."""
        with self._database.read() as session:
            return _shown(session, _row(session, collection, job_id))

    def page(self, collection: CollectionNumber, *, before: int, limit: int) -> JobPage:
        """Return one page of a collection's jobs, the latest first."""
        with self._database.read() as session:
            rows = repository.page(session, collection, before=before, limit=limit + 1)
            return JobPage(
                jobs=[_shown(session, row) for row in rows[:limit]],
                total=repository.count(session, collection),
                next_cursor=write_cursor(rows[limit - 1].number) if len(rows) > limit else None,
            )

    def files(
        self, collection: CollectionNumber, job_id: str, outcome: Outcome | None, *, start: int, limit: int
    ) -> JobFilePage:
        """Return one page of the members of a job from a position on, in the order of the archive."""
        with self._database.read() as session:
            job = _row(session, collection, job_id)
            rows = repository.files(session, job.number, outcome, start=start, limit=limit + 1)
            counts = repository.counts(session, job.number)
            return JobFilePage(
                files=[
                    JobFile.of(row, "cancelled" if job.state in ENDED else "waiting") for row in rows[:limit]
                ],
                total=sum(counts.values()) if outcome is None else counts.get(outcome, 0),
                next_cursor=write_cursor(rows[limit].position) if len(rows) > limit else None,
            )

    def cancel(self, collection: CollectionNumber, job_id: str, *, forget: bool = False) -> None:
        """End a job unless it has ended; no further shapes are stored. With `forget`, delete its record."""
        with self._database.write() as session:
            job = _row(session, collection, job_id)
            repository.end(session, job.number, "cancelled")
            if forget:
                repository.remove(session, job.number)
        self._remove_unless_active(job_id)

    def claim(self, runner: str, besides: Collection[str]) -> tuple[JobRow | None, bool]:
        """Clear old records, and take over a job that no living service runs, but none of some clients.

        Return the oldest such job, or None, and whether any job is unfinished.
        """
        is_open = self.clear(timedelta(days=self._settings.job_days))
        if not is_open:
            return None, False
        with self._database.write() as session:
            return repository.claim(session, runner, besides), True

    def begin(
        self, job: JobRow, read_directory: ReadDirectory
    ) -> Generator[tuple[JobFileRow, bytes | MemberFault]]:
        """List the members of a job, unless they are listed, and yield those without an outcome.

        Each comes with its bytes or the reason of its refusal. `read_directory`: see `ZipArchive`. Raise
        ArchiveTooLargeError if the archive exceeds the limits, MalformedArchiveError if it is not a ZIP, or
        is not in the folder, and StorageUnavailableError if the disk fails.
        """
        with self._opened(job.id) as file:
            archive = ZipArchive(file, self._settings, read_directory)
            if job.state == "waiting":
                members = archive.members()
                with self._database.write() as session:
                    repository.begin(session, job.number, members)
            with self._database.read() as session:
                unread = {row.position: row for row in repository.without_outcome(session, job.number)}
            for position, content in archive.read(frozenset(unread)):
                yield unread.pop(position), content
        for row in unread.values():
            yield row, MemberError("member-damaged", "the archive is damaged before this file")

    def _opened(self, job_id: str) -> BinaryIO:
        path = self.archive_path(job_id)
        with disk_errors("the archive cannot be read"):
            if not path.exists():
                raise MalformedArchiveError(
                    "the archive is not in the folder of this service (ISOSHAPE_JOB_FOLDER); send it again"
                )
            return path.open("rb")

    def end(self, job: JobRow, state: State, fault: MemberFault | None = None) -> None:
        """End a job, unless it has ended, and delete its archive; its stored shapes stay."""
        with self._database.write() as session:
            repository.end(session, job.number, state, fault)
        self._remove_unless_active(job.id)

    def clear(self, keep: timedelta) -> bool:
        """Delete records of jobs that ended before `keep`, and files of no job.

        Return whether a job is unfinished.
        """
        with self._database.read() as session:
            active = repository.active(session)
            gone = repository.ended_before(session, datetime.now(UTC) - keep)
        for number in gone:
            with self._database.write(deleting=True) as session:
                repository.remove(session, number)
        for path in self._folder.glob(_ARCHIVES):
            # Another service may delete the file meanwhile.
            with suppress(OSError):
                if path.stem not in active and path.stat().st_mtime < time.time() - ORPHAN_SECONDS:
                    path.unlink()
        return bool(active)

    def _remove_unless_active(self, job_id: str) -> None:
        """Remove the archive of a job that has ended or is not stored; if the disk fails, `clear` does it."""
        with suppress(OSError, ServiceError), self._database.read() as session:
            if job_id not in repository.active(session):
                self.archive_path(job_id).unlink(missing_ok=True)

    def _check_room(self, session: ReadSession, client: str) -> None:
        """Raise BusyError unless more jobs may come than the client has: none fills the room of others."""
        active = Counter(repository.active(session).values())
        if active[client] >= self._settings.max_jobs - active.total():
            raise BusyError(
                f"{active.total()} jobs are unfinished, {active[client]} of them of this client; send the "
                "archive when one has ended"
            )


def _row(session: ReadSession, collection: CollectionNumber, job_id: str) -> JobRow:
    job = repository.by_id(session, collection, job_id)
    if job is None:
        raise JobNotFoundError(job_id)
    return job


def _shown(session: ReadSession, job: JobRow) -> Job:
    """Return the JSON of a job, with its recent speed in members per second."""
    rate = None
    if job.state == "running" and job.started_at is not None:
        ends = repository.latest_ends(session, job.number, job.started_at, RATE_WINDOW + 1)
        since = job.started_at if len(ends) <= RATE_WINDOW else ends[-1]
        seconds = (datetime.now(UTC) - since).total_seconds()
        rate = min(len(ends), RATE_WINDOW) / seconds if ends and seconds > 0 else None
    counts = repository.counts(session, job.number)
    ignored = repository.count_refused(session, job.number, UnknownFormatError.kind)
    return Job.of(job, counts, ignored, rate)


def _copy(file: BinaryIO, path: Path) -> int:
    """Copy an archive into its folder, durably and under its name only when it is complete; its size."""
    partial = path.with_suffix(".partial")
    try:
        make_folder(path.parent)
        file.seek(0)
        with partial.open("xb") as copy:
            os.fchmod(copy.fileno(), 0o600)
            shutil.copyfileobj(file, copy, 1024 * 1024)
            size = copy.tell()
        put_in_place(partial, path)
        return size
    finally:
        partial.unlink(missing_ok=True)
