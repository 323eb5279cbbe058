"""The scanner of a service: it scans sources that changed, and watches their folders.

A service that watches scans every source at its start, when its folder reports a change, and from time to
time. Without sources, it reads one row of the database every few seconds.
"""

import asyncio
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any, NoReturn

from starlette.concurrency import run_in_threadpool

from service.compute.request_queue import end
from service.container import Container
from service.errors import ServiceError
from service.http.middleware import unless
from service.observability.logging import get_logger
from service.sources import repository, service
from service.sources.repository import LEASE, SourceLostError
from service.sources.scan import OfflineError, SourceScan
from service.sources.storing import Places
from service.sources.watching import Watch
from service.storage.tables import SourceRow

log = get_logger("sources")

LOOK_SECONDS = 5.0
"""Interval at which the scanner looks for sources, and for scans that another process asks for."""

POLL_SECONDS = 60.0
"""The interval of scans of folders that report no changes, such as those of network mounts, or are absent."""

RARE_SECONDS = 3600.0
"""The interval of scans of folders that report changes."""

LEFT_SECONDS = 3.0
"""The time until a file is read that was being written."""

REST = 4.0
"""The scanner rests so many times as long as it took to compare a source with its folder."""

HOUSEKEEPING_SECONDS = 600.0
PROGRESS_SECONDS = 1.0
BEAT_SECONDS = LEASE.total_seconds() / 4
PAUSE_SECONDS = 5.0


class Scanner:
    """The scanner of an archive's sources, in the event loop of a service. Call `start`, then `stop`.

    Parameters
    ----------
    container : Container
    watches : bool
        Whether to scan without being asked to.
    """

    def __init__(self, container: Container, *, watches: bool) -> None:
        self._container, self._database = container, container.database
        self._watches = watches
        self._id = str(uuid.uuid4())
        self._look = asyncio.Event()
        self._due: dict[int, float] = {}
        self._rests_until: dict[int, float] = {}
        self._places = Places(container)
        self._scans: dict[int, asyncio.Task[None]] = {}
        # Sources whose folders have changed since their scan began.
        self._changed_since: set[int] = set()
        self._watch = Watch(self._changed)
        self._running: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Start the scanner."""
        self._running = asyncio.create_task(self._run())

    def look(self) -> None:
        """Look now for a scan that was asked for."""
        self._look.set()

    async def stop(self) -> None:
        """Stop at once: the next scan goes on with what is not stored."""
        assert self._running is not None
        await end(self._running)

    def _changed(self, number: int) -> None:
        """Scan a source whose folder reports a change, as soon as its last scan is long enough ago."""
        if number in self._scans:
            self._changed_since.add(number)
        due = max(time.monotonic(), self._rests_until.get(number, 0.0))
        self._due[number] = min(self._due.get(number, due), due)
        self.look()

    async def _run(self) -> None:
        housekeeping = 0.0
        try:
            while True:
                try:
                    if time.monotonic() >= housekeeping:
                        keep = self._container.settings.undo_time
                        await run_in_threadpool(service.forget_removed, self._database, keep)
                        housekeeping = time.monotonic() + HOUSEKEEPING_SECONDS
                    sources = await self._database.reading(repository.listed)
                    if self._watches:
                        await self._watch.follow({row.number: row.root for row in sources})
                    for source in self._wanted(sources):
                        work = asyncio.create_task(self._scan_whole(source))
                        work.add_done_callback(lambda _: self.look())
                        self._scans[source.number] = work
                    await self._wait()
                except Exception as error:
                    log.warning("sources wait: %s", error, exc_info=not isinstance(error, ServiceError))
                    await asyncio.sleep(PAUSE_SECONDS)
        finally:
            for work in self._scans.values():
                work.cancel()
            await asyncio.gather(*self._scans.values(), return_exceptions=True)
            await self._watch.stop()

    def _wanted(self, sources: Sequence[SourceRow]) -> list[SourceRow]:
        """Return the sources to scan now; one that is being scanned is not."""
        now = time.monotonic()
        self._scans = {number: scan for number, scan in self._scans.items() if not scan.done()}
        known = {source.number for source in sources}
        self._due = {number: due for number, due in self._due.items() if number in known}
        return [
            source
            for source in sources
            if source.number not in self._scans
            and (
                source.requested
                or repository.is_abandoned(source)
                or (self._watches and self._due.get(source.number, 0.0) <= now)
            )
        ]

    async def _wait(self) -> None:
        """Wait for a request, or until a source is due, but no longer than `LOOK_SECONDS`."""
        waiting = [due for number, due in self._due.items() if self._watches and number not in self._scans]
        next_due = min(waiting, default=float("inf"))
        # wait_for of Python 3.11 loses a cancellation that meets the event.
        with suppress(TimeoutError):
            async with asyncio.timeout(min(LOOK_SECONDS, max(0.0, next_due - time.monotonic()))):
                await self._look.wait()
        self._look.clear()

    async def _scan_whole(self, source: SourceRow) -> None:
        """Scan a source; after a failure, wait before the next attempt."""
        try:
            await self._scan(source)
        except ServiceError as error:
            log.warning("the source %s waits: %s", source.name, error)
            await asyncio.sleep(PAUSE_SECONDS)
        except Exception as error:
            log.error("a scan failed", exc_info=error)
            await asyncio.sleep(PAUSE_SECONDS)

    async def _scan(self, source: SourceRow) -> None:
        """Scan a source, unless another service does."""
        number, start = source.number, time.monotonic()
        self._changed_since.discard(number)
        claimed = await self._database.writing(repository.claim, number, self._id)
        if claimed is None:
            self._due[number] = start + LOOK_SECONDS
            return
        scan = SourceScan(self._container, claimed, self._places)
        ended: dict[str, Any] = {"state": "waiting"}
        try:
            await unless(self._renew_until_lost(scan, number), scan.run())
            ended = {"state": "ready", "detail": None, "confirmed": False, "scanned_at": datetime.now(UTC)}
        except OfflineError as error:
            log.warning("the source %s is offline: %s", claimed.name, error)
            ended = {"state": "offline", "detail": str(error)[: repository.DETAIL_CHARACTERS]}
        except SourceLostError:
            log.info("a source was removed, or another service scans it")
        except (ServiceError, asyncio.CancelledError):
            # The scan goes on when the database and the workers are there.
            ended = {"state": "waiting", "requested": True}
            raise
        except Exception:
            ended = {"state": "offline", "detail": "the scan failed; the service's log has the reason"}
            raise
        finally:
            report = scan.report.model_dump()
            with suppress(ServiceError):
                await asyncio.shield(
                    self._database.writing(repository.release, number, self._id, {**ended, "report": report})
                )
            now = time.monotonic()
            self._rests_until[number] = now + REST * (scan.compared_seconds or now - start)
            is_watched = ended.get("state") == "ready" and self._watch.follows(number)
            wait = LEFT_SECONDS if scan.report.left else RARE_SECONDS if is_watched else POLL_SECONDS
            wait = 0.0 if number in self._changed_since else wait
            self._due[number] = max(self._rests_until[number], now + wait)

    async def _renew_until_lost(self, scan: SourceScan, number: int) -> NoReturn:
        """Renew the lease of a scan and write its counts; SourceLostError ends this."""
        while True:
            await asyncio.sleep(PROGRESS_SECONDS)
            report = scan.report.model_dump()
            await self._database.writing(repository.renew, number, self._id, report)
