"""The runner of bulk jobs, which processes the jobs of each client in the order of their creation.

The jobs of several clients run at a time, and their members take turns.

A member is stored like an upload, and its outcome is committed with its shape: if a service is killed, each
member has both or neither, and the next service continues with the members without an outcome.
"""

import asyncio
import uuid
from collections import Counter
from collections.abc import Iterator
from contextlib import AsyncExitStack, closing, contextmanager, suppress
from typing import NoReturn

from starlette.concurrency import run_in_threadpool

from core.errors import CoreError
from core.io import format_of
from service.collection import CollectionNumber
from service.compute.request_queue import end, together, whole
from service.container import Container
from service.errors import (
    PROBLEMS,
    BadRequestFieldsError,
    BusyError,
    ClusterUnavailableError,
    FileTimeLimitError,
    PipelineUnavailableError,
    ServiceError,
    StorageFullError,
    StorageUnavailableError,
    WorkerLostError,
)
from service.http.middleware import unless
from service.jobs import repository
from service.jobs.repository import LEASE, JobLostError
from service.jobs.schemas import Outcome
from service.jobs.service import Jobs
from service.jobs.zip_archive import ArchiveTooLargeError, MalformedArchiveError, MemberFault
from service.observability.logging import get_logger
from service.shapes.records import NewShape, StoredShape
from service.shapes.service import ingest
from service.storage.database import WriteSession
from service.storage.tables import JobFileRow, JobRow
from service.turns import Turns, counted, current_client

log = get_logger("jobs")

# Interval at which the runner looks for jobs of dead services and for records to delete.
LOOK_SECONDS = 2.0
IDLE_SECONDS = 10.0
BEAT_SECONDS = LEASE.total_seconds() / 4
# The wait after an internal error; the member is not refused.
PAUSES = (1.0, 2.0, 5.0, 10.0, 30.0)
# The most archives of one client that are received at a time: they occupy the temporary folder until they are
# stored.
ARRIVING = 2
# Lack of memory, rather than the file, may have killed a worker.
TRIES = 2

# Errors that the member did not cause.
OWN_FAULTS = (StorageFullError, StorageUnavailableError, PipelineUnavailableError, ClusterUnavailableError)

# The number of unexpected failures after which a job is ended.
FAULTS = 3
UNFORESEEN = ServiceError(PROBLEMS[ServiceError.kind].title)


class Runner:
    """The runner of an archive's jobs, in the event loop of a service. Call `start`, then `stop`.

    `followers` has the number of open event streams of each client.
    """

    def __init__(self, container: Container) -> None:
        self._container, self._database = container, container.database
        self.jobs = Jobs(container.database, container.settings)
        self.in_thread = container.database.in_thread
        self._id = str(uuid.uuid4())
        self._changes: set[asyncio.Event] = set()
        # Members of archives, which clients get in turn, and those of each client that are at work.
        self._members = Turns(container.settings.workers)
        self._active: Counter[str] = Counter()
        self.followers: Counter[str] = Counter()
        self._arriving: Counter[str] = Counter()
        # Failures of the jobs of each client since one of them ended, and unexpected ones of each job.
        self._failures: Counter[str] = Counter()
        self._faults: Counter[str] = Counter()
        self._running: asyncio.Task[None] | None = None

    @property
    def active_members(self) -> int:
        """The number of members at work."""
        return self._active.total()

    def start(self) -> None:
        """Start the runner."""
        self._running = asyncio.create_task(self._run())

    def look(self) -> None:
        """Check now for a new, cancelled or ended job."""
        for change in self._changes:
            change.set()

    @contextmanager
    def arriving(self, client: str) -> Iterator[None]:
        """Count an archive of a client that is being received, until the end of the block.

        Raise BusyError if the largest number of archives of the client is being received.
        """
        if self._arriving[client] >= ARRIVING:
            raise BusyError(
                f"{ARRIVING} archives of this client are being received; try again when one is complete"
            )
        with counted(self._arriving, client):
            yield

    async def stop(self) -> None:
        """Stop at once: the next start continues with the members that are not stored."""
        assert self._running is not None
        self._container.queue.stop()
        await end(self._running)
        with suppress(ServiceError):
            await self._database.writing(repository.release, self._id)

    async def _run(self) -> None:
        """Work on the oldest job of each client."""
        pauses = iter(PAUSES)
        works: dict[str, asyncio.Task[None]] = {}
        with self._watched() as change:
            try:
                while True:
                    works = {name: work for name, work in works.items() if not work.done()}
                    try:
                        job, is_open = await run_in_threadpool(self.jobs.claim, self._id, works.keys())
                    except Exception as error:
                        await self._pause(error, next(pauses, PAUSES[-1]))
                        continue
                    pauses = iter(PAUSES)
                    if job is None:
                        await _changed(change, LOOK_SECONDS if is_open else IDLE_SECONDS)
                        continue
                    works[job.client] = asyncio.create_task(self._keep_at(job))
                    works[job.client].add_done_callback(lambda _: self.look())
            finally:
                for work in works.values():
                    work.cancel()
                await asyncio.gather(*works.values(), return_exceptions=True)

    async def _keep_at(self, job: JobRow) -> None:
        """Work on a job for its client; after a failure, wait before the client's next attempt."""
        current_client.set(job.client)
        try:
            await self._work_on(job)
        except Exception as error:
            self._failures[job.client] += 1
            await self._pause(error, PAUSES[min(self._failures[job.client], len(PAUSES)) - 1])
        else:
            del self._failures[job.client]

    async def _pause(self, error: Exception, seconds: float) -> None:
        if isinstance(error, OWN_FAULTS):
            log.warning("jobs wait: %s", error)
        else:
            log.error("working on jobs failed", exc_info=error)
        await asyncio.sleep(seconds)

    async def _work_on(self, job: JobRow) -> None:
        """Process the rest of a job; returns when it has ended, here or in another service."""
        log.info("a job starts or continues", extra={"fields": {"job": job.id}})
        try:
            await unless(self._renew_until_lost(job), self._do(job))
            del self._faults[job.id]
            log.info("a job has ended", extra={"fields": {"job": job.id}})
        except JobLostError:
            log.info("a job was ended or taken over by another service", extra={"fields": {"job": job.id}})
        except OWN_FAULTS:
            raise
        except (ArchiveTooLargeError, MalformedArchiveError) as error:
            await run_in_threadpool(self.jobs.end, job, "failed", error)
        except Exception:
            self._faults[job.id] += 1
            if self._faults[job.id] == FAULTS:
                # Later jobs must not wait forever.
                del self._faults[job.id]
                await run_in_threadpool(self.jobs.end, job, "failed", UNFORESEEN)
            raise

    async def _do(self, job: JobRow) -> None:
        turn = asyncio.Lock()
        with closing(self.jobs.begin(job, self._container.queue.zip_directory)) as members:
            workers = range(self._container.settings.workers)
            await together(self._take(job, members, turn) for _ in workers)
        await run_in_threadpool(self.jobs.end, job, "done")

    async def _take(
        self, job: JobRow, members: Iterator[tuple[JobFileRow, bytes | MemberFault]], turn: asyncio.Lock
    ) -> None:
        """Process members, one after another, until none is left."""
        while True:
            # A member is read once its client has a turn: no more of them are in memory.
            async with AsyncExitStack() as stack:
                async with turn:
                    await stack.enter_async_context(self._members.turn())
                    taken = await whole(run_in_threadpool(next, members, None))
                if taken is None:
                    return
                file, data = taken
                if not isinstance(data, bytes):
                    await self._database.writing(repository.settle, file, "refused", fault=data)
                    continue
                await self._container.queue.until_spare(self._active.total, lambda: self._active[job.client])
                with counted(self._active, job.client):
                    await self._store(job, file, data)

    async def _store(self, job: JobRow, file: JobFileRow, data: bytes) -> None:
        """Store a member like an upload, or write the reason of refusal."""

        def settle(session: WriteSession, stored: StoredShape) -> None:
            outcome: Outcome = "stored" if stored.created else "present"
            repository.settle(session, file, outcome, shape_id=stored.shape.id)

        collection, tags = CollectionNumber(job.collection_number), tuple(job.tags)
        fault: MemberFault
        for tries_left in reversed(range(TRIES)):
            try:
                shape = NewShape(data, format_of(file.name), collection, file.name, tags, job.meta)
                await ingest(self._container, shape, also=settle)
                return
            except (JobLostError, *OWN_FAULTS):
                raise
            except (CoreError, FileTimeLimitError, BadRequestFieldsError) as error:
                fault = error
                break
            except WorkerLostError as error:
                fault = error
            except Exception as error:
                log.error("a member of an archive could not be stored", exc_info=error)
                fault = UNFORESEEN
            if tries_left:
                await asyncio.sleep(PAUSES[0])
        await self._database.writing(repository.settle, file, "refused", fault=fault)

    async def _renew_until_lost(self, job: JobRow) -> NoReturn:
        """Renew the lease of a job; JobLostError ends this."""
        with self._watched() as change:
            while True:
                await _changed(change, BEAT_SECONDS)
                await self._database.writing(repository.renew, job.number, self._id)

    @contextmanager
    def _watched(self) -> Iterator[asyncio.Event]:
        """Yield an event that `look` sets, for the duration of the block."""
        change = asyncio.Event()
        self._changes.add(change)
        try:
            yield change
        finally:
            self._changes.discard(change)


async def _changed(change: asyncio.Event, seconds: float) -> None:
    """Wait for a change, but no longer than some seconds."""
    # wait_for of Python 3.11 loses a cancellation that meets the change.
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await change.wait()
    change.clear()
