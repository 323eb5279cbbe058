"""The runner of bulk jobs, which processes jobs in the order of their creation, member by member.

A member is stored like an upload, and its outcome is committed with its shape: if a service is killed, each
member has both or neither, and the next service continues with the members without an outcome.
"""

import asyncio
import time
import uuid
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta

from starlette.concurrency import run_in_threadpool

from core.errors import CoreError
from service.container import Container
from service.errors import (
    PROBLEMS,
    BusyError,
    ClusterUnavailableError,
    FileTimeLimitError,
    PipelineUnavailableError,
    ServiceError,
    StorageFullError,
    StorageUnavailableError,
    WorkerLostError,
)
from service.jobs import repository, service
from service.jobs.records import FailureCause, FileRecord, JobRecord, Outcome
from service.jobs.zip_archive import ArchiveTooLargeError, MalformedArchiveError, MemberFault
from service.observability.logging import get_logger
from service.shapes.records import StoredShape
from service.shapes.service import ingest
from service.storage.database import WriteSession

log = get_logger("jobs")

# Interval at which the runner looks for jobs of dead services and for records to delete.
LOOK_SECONDS = 2.0
IDLE_SECONDS = 10.0
# Without renewal for this long, a service counts as dead and others may run its jobs.
LEASE = timedelta(seconds=10)
BEAT_SECONDS = LEASE.total_seconds() / 4
# The wait after an internal error; the member is not refused.
PAUSES = (1.0, 2.0, 5.0, 10.0, 30.0)
ROOM_SECONDS = 0.02
# The most archives of one client that are received at a time: they occupy the temporary folder until they are
# stored.
ARRIVING = 2
# Requests have priority, but a job waits no longer than this.
PATIENCE_SECONDS = 5.0
# Lack of memory, rather than the file, may have killed a worker.
TRIES = 2

# Errors that the member did not cause.
OWN_FAULTS = (StorageFullError, StorageUnavailableError, PipelineUnavailableError, ClusterUnavailableError)

# The number of unexpected failures after which a job is ended.
FAULTS = 3
UNFORESEEN = FailureCause(ServiceError.kind, PROBLEMS[ServiceError.kind].title)


class JobLostError(Exception):
    """The job has ended, or another service runs it."""


class Runner:
    """The runner of an archive's jobs, in the event loop of a service. Call `start`, then `stop`.

    `followers` contains the open event streams, and `folder` the archives of unfinished jobs.
    """

    def __init__(self, container: Container) -> None:
        self._container = container
        self._database = container.database
        self._limits = service.limits_of(container.settings)
        self.folder = service.folder_of(container.settings)
        self._id = str(uuid.uuid4())
        self._look = asyncio.Event()
        self._active_members = 0
        self.followers: set[object] = set()
        self._arriving: Counter[str] = Counter()
        self._open = False
        self._faults = 0
        self._running: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Start the runner."""
        self._running = asyncio.create_task(self._run())

    def look(self) -> None:
        """Check now for a new or cancelled job."""
        self._look.set()

    @property
    def active_members(self) -> int:
        """The number of members that are being processed."""
        return self._active_members

    @contextmanager
    def arriving(self, client: str) -> Iterator[None]:
        """Count an archive of a client that is being received, until the end of the block.

        Raises
        ------
        BusyError
            The largest number of archives of the client is being received.
        """
        if self._arriving[client] >= ARRIVING:
            raise BusyError(
                f"{ARRIVING} archives of this client are being received; try again when one is complete"
            )
        self._arriving[client] += 1
        try:
            yield
        finally:
            self._arriving[client] -= 1
            if not self._arriving[client]:
                del self._arriving[client]

    async def stop(self) -> None:
        """Stop at once: the next start continues with the members that are not stored."""
        assert self._running is not None
        self._running.cancel()
        with suppress(asyncio.CancelledError):
            await self._running
        with suppress(ServiceError):
            await run_in_threadpool(self._release)

    async def _run(self) -> None:
        pauses = iter(PAUSES)
        while True:
            try:
                job = await run_in_threadpool(self._claim)
                if job is None:
                    await self._changed(LOOK_SECONDS if self._open else IDLE_SECONDS)
                    continue
                await self._work_on(job)
                pauses = iter(PAUSES)
            except OWN_FAULTS as error:
                log.warning("jobs wait: %s", error)
                await asyncio.sleep(next(pauses, PAUSES[-1]))
            except Exception as error:
                log.error("working on jobs failed", exc_info=error)
                await asyncio.sleep(next(pauses, PAUSES[-1]))

    async def _work_on(self, job: JobRecord) -> None:
        """Process the rest of a job; returns when it has ended, here or in another service."""
        log.info("a job starts or continues", extra={"fields": {"job": job.id}})
        renewal = asyncio.create_task(self._renew_until_ended(job))
        doing = asyncio.create_task(self._do(job))
        try:
            await asyncio.wait({renewal, doing}, return_when=asyncio.FIRST_COMPLETED)
            (doing if doing.done() else renewal).result()
            self._faults = 0
            log.info("a job has ended", extra={"fields": {"job": job.id}})
        except JobLostError:
            log.info("a job was ended or taken over by another service", extra={"fields": {"job": job.id}})
        except OWN_FAULTS:
            raise
        except (ArchiveTooLargeError, MalformedArchiveError) as error:
            await run_in_threadpool(self._fail, job, service.cause_of(error))
        except Exception:
            self._faults += 1
            if self._faults == FAULTS:
                # Later jobs must not wait forever.
                self._faults = 0
                await run_in_threadpool(self._fail, job, UNFORESEEN)
            raise
        finally:
            for task in (doing, renewal):
                task.cancel()
            await asyncio.gather(doing, renewal, return_exceptions=True)

    async def _do(self, job: JobRecord) -> None:
        if job.state == "waiting":
            await run_in_threadpool(service.begin, self._database, self.folder, job, self._limits)
        files = await run_in_threadpool(self._left, job)
        members = service.unprocessed(self.folder, job, files, self._limits)
        turn = asyncio.Lock()
        try:
            async with asyncio.TaskGroup() as group:
                for _ in range(self._container.settings.workers):
                    group.create_task(self._take(job, members, turn))
        except ExceptionGroup as several:
            raise several.exceptions[0] from None
        await run_in_threadpool(service.finish, self._database, self.folder, job)

    async def _take(
        self, job: JobRecord, members: Iterator[tuple[FileRecord, bytes | MemberFault]], turn: asyncio.Lock
    ) -> None:
        """Process members, one after another, until none is left."""
        while True:
            async with turn:
                taken = await run_in_threadpool(next, members, None)
            if taken is None:
                return
            file, data = taken
            if not isinstance(data, bytes):
                await self._refuse(job, file, service.cause_of(data))
                continue
            await self._wait_for_worker()
            self._active_members += 1
            try:
                await self._store(job, file, data)
            finally:
                self._active_members -= 1

    async def _store(self, job: JobRecord, file: FileRecord, data: bytes) -> None:
        """Store a member like an upload, or write the reason of refusal."""

        def settle(session: WriteSession, stored: StoredShape) -> None:
            outcome: Outcome = "stored" if stored.created else "present"
            now, shape_id = datetime.now(UTC), stored.shape.id
            if not repository.settle(session, job.number, file.position, outcome, now, shape_id=shape_id):
                raise JobLostError

        for tries_left in reversed(range(TRIES)):
            try:
                await ingest(self._container, service.shape_of(job, file, data), also=settle)
                return
            except (JobLostError, *OWN_FAULTS):
                raise
            except (CoreError, FileTimeLimitError) as error:
                cause = service.cause_of(error)
                break
            except WorkerLostError as error:
                cause = service.cause_of(error)
            except Exception as error:
                log.error("a member of an archive could not be stored", exc_info=error)
                cause = UNFORESEEN
            if tries_left:
                await asyncio.sleep(PAUSES[0])
        await self._refuse(job, file, cause)

    async def _refuse(self, job: JobRecord, file: FileRecord, cause: FailureCause) -> None:
        def write() -> None:
            with self._database.write() as session:
                now = datetime.now(UTC)
                if not repository.settle(session, job.number, file.position, "refused", now, cause=cause):
                    raise JobLostError

        await run_in_threadpool(write)

    async def _wait_for_worker(self) -> None:
        """Wait for a worker that no request needs."""
        since = time.monotonic()
        while self._container.queue.inside + self._active_members >= self._container.settings.workers:
            if not self._active_members and time.monotonic() - since > PATIENCE_SECONDS:
                return
            await asyncio.sleep(ROOM_SECONDS)

    async def _renew_until_ended(self, job: JobRecord) -> None:
        """Renew the lease of a job until the job has ended or the lease is lost."""
        while True:
            await self._changed(BEAT_SECONDS)
            if not await run_in_threadpool(self._renew, job):
                raise JobLostError

    async def _changed(self, seconds: float) -> None:
        """Wait for a change, but no longer than some seconds."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._look.wait(), seconds)
        self._look.clear()

    def _claim(self) -> JobRecord | None:
        keep = timedelta(days=self._container.settings.job_days)
        self._open = service.clear(self._database, self.folder, keep)
        if not self._open:
            return None
        now = datetime.now(UTC)
        with self._database.write() as session:
            return repository.claim(session, self._id, now + LEASE, now)

    def _fail(self, job: JobRecord, cause: FailureCause) -> None:
        service.fail(self._database, self.folder, job, cause)

    def _left(self, job: JobRecord) -> list[FileRecord]:
        with self._database.read() as session:
            return repository.without_outcome(session, job.number)

    def _renew(self, job: JobRecord) -> bool:
        with self._database.write() as session:
            return repository.renew(session, job.number, self._id, datetime.now(UTC) + LEASE)

    def _release(self) -> None:
        with self._database.write() as session:
            repository.release(session, self._id)
