"""Runs of a change of an archive, each in a child of this process: with a fault of the disk, and after it.

The process that forks has one thread, and has loaded what the service needs. `faults.c` is preloaded into it.
"""

import asyncio
import ctypes
import gc
import json
import multiprocessing
import os
import random
import shutil
import signal
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import httpx

from service.errors import ExpectedError, ServiceError
from tests.service.sources.support import put
from tests.soak.kill.changes import (
    CHANGES,
    FILES,
    MODELS,
    Change,
    State,
    finished,
    make_archive,
    run_command,
    state,
)
from tests.soak.kill.inline import InlineService
from tests.soak.kill.power import Disk, Operation, operations

READY_SECONDS, JOB_SECONDS, FAILING_SECONDS, RUN_SECONDS = 5.0, 20.0, 0.2, 120

Said = dict[str, Any]
Say = Callable[..., object]


class Fault(NamedTuple):
    """An action of `faults.c` at the operation with a number, from 1."""

    action: str
    point: int

    @property
    def is_failure(self) -> bool:
        """Whether the operation fails and the process lives."""
        return self.action in "eES"


NONE = Fault("-", 0)


class Expected(NamedTuple):
    """The states before and after a change."""

    before: State
    after: State


class Helper:
    """A child that does what no kill ends, one thing after another, until the parent ends."""

    def __init__(self, runs: "Runs") -> None:
        self._connection, end = multiprocessing.Pipe()
        if not os.fork():
            self._connection.close()
            with suppress(EOFError):
                while True:
                    name, *arguments = end.recv()
                    said: Said = {"faults": []}
                    try:
                        getattr(runs, name)(said.update, *arguments)
                    except Exception:
                        said["faults"] = [traceback.format_exc()]
                    # A thread that is late must not close its connection in the folder of the next run.
                    join_threads()
                    end.send(said)
            os._exit(0)
        end.close()

    def do(self, name: str, *arguments: object) -> Said:
        """Call a method of the runs; what it said."""
        self._connection.send((name, *arguments))
        assert self._connection.poll(RUN_SECONDS), f"{name} {arguments} stands still"
        return dict(self._connection.recv())


def join_threads() -> None:
    """Wait until this process has one thread, and no connection that another holds."""
    for thread in threading.enumerate()[1:]:
        thread.join(JOB_SECONDS)
    assert threading.active_count() == 1


def forked(work: Callable[[Say], None]) -> Said:
    """Do something in a child; what it said, its faults, and whether it was killed."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        signal.alarm(RUN_SECONDS)
        try:
            work(lambda **said: os.write(writing, json.dumps(said).encode() + b"\n"))
        except BaseException:
            os.write(writing, json.dumps({"faults": [traceback.format_exc()]}).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as lines:
        said = {"faults": [], **{name: value for line in lines for name, value in json.loads(line).items()}}
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    said["killed"] = ended == -signal.SIGKILL
    if ended not in {0, -signal.SIGKILL}:
        said["faults"].append(f"the process ended with {ended}")
    return said


class Runs:
    """The runs, one after another in the folder `place`."""

    def __init__(self, folder: Path) -> None:
        self.place, self._log = folder / "place", folder / "log"
        self._empty, self._archive = folder / "empty", folder / "archive"
        self._log_file = os.open(self._log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._library = ctypes.CDLL(None)
        os.chdir(folder)
        for path, data in FILES.items():
            put(MODELS / path, data)
        self._service = InlineService(self.place)

    def prepare(self) -> None:
        """Make the folders that changes begin with, and make each change once in this process."""
        (self._empty / "tmp").mkdir(parents=True)
        shutil.copytree(self._empty, self.place)

        async def make() -> None:
            async with self._service.client() as client:
                await make_archive(client, self.place)

        asyncio.run(make())
        shutil.copytree(self.place, self._archive)
        for change in CHANGES:
            self.renew(change)
            self._make(lambda **_: None, change, NONE, None)
        # Threads do not survive a fork.
        join_threads()
        gc.collect()
        # A child that collects garbage would copy the memory of all modules.
        gc.freeze()
        self._helper = Helper(self)

    def renew(self, change: Change) -> None:
        """Put what the change begins with into the folder."""
        shutil.rmtree(self.place, ignore_errors=True)
        shutil.copytree(self._empty if change.is_first else self._archive, self.place)

    def make(
        self, change: Change, fault: Fault = NONE, expected: Expected | None = None
    ) -> tuple[Said, Disk]:
        """Make a change anew; what the child said, and what became of the disk.

        Where an operation fails, the same service is verified once the fault is over.
        """
        self.renew(change)
        disk = Disk(self.place)
        if fault.is_failure:
            said = self._helper.do("_make", change, fault, expected)
        else:
            said = forked(lambda say: self._make(say, change, fault, expected))
        for operation in self.log():
            disk.do(operation)
        return said, disk

    def log(self) -> list[Operation]:
        """The operations of the last run."""
        return list(operations(self._log.read_bytes()))

    def reopen(self, change: Change, acknowledged: bool = True, expected: Expected | None = None) -> Said:
        """Start the service on what is in the folder, and verify it."""
        return self._helper.do("_reopen", change, acknowledged, expected)

    def _make(self, say: Say, change: Change, fault: Fault, expected: Expected | None) -> None:
        if change.request is not None:
            asyncio.run(self._ask(say, change, fault, expected))
            return
        self._begin(fault)
        acknowledged = self._starts() if change.is_first else run_command(change.command, self.place) == 0
        self._library.faults_end()
        say(acknowledged=acknowledged)
        if fault.is_failure:
            self._reopen(say, change, acknowledged, expected)

    def _begin(self, fault: Fault) -> None:
        os.truncate(self._log, 0)
        place, point = os.fsencode(self.place), ctypes.c_long(fault.point)
        self._library.faults_begin(place, self._log_file, ord(fault.action), point)

    def _starts(self) -> bool:
        async def start() -> None:
            async with self._service.client():
                pass

        try:
            asyncio.run(start())
        except (ServiceError, ExpectedError):
            return False
        return True

    async def _ask(self, say: Say, change: Change, fault: Fault, expected: Expected | None) -> None:
        assert change.request is not None
        async with self._service.client(is_timed=fault.is_failure) as client:
            self._begin(fault)
            answer = await change.request(client)
            say(acknowledged=answer.is_success)
            await finished(client, FAILING_SECONDS if fault.is_failure else JOB_SECONDS)
            # The archive of a job goes after the job has ended.
            while not fault.is_failure and any(self.place.glob("elsewhere/jobs/*.zip")):
                await asyncio.sleep(0.01)
            self._library.faults_end()
            is_refused = answer.status_code in {503, 507} and "retry-after" in answer.headers
            if not (answer.is_success or is_refused):
                say(faults=[f"answered {answer.status_code}: {answer.text}"])
            elif fault.is_failure:
                say(**await self._verified(client, change, answer.is_success, expected, time.monotonic()))

    def _reopen(self, say: Say, change: Change, acknowledged: bool, expected: Expected | None) -> None:
        # Other identifiers than those of the run before.
        random.seed()

        async def reopen() -> None:
            began = time.monotonic()
            async with self._service.client() as client:
                say(**await self._verified(client, change, acknowledged, expected, began))

        asyncio.run(reopen())

    async def _verified(
        self,
        client: httpx.AsyncClient,
        change: Change,
        acknowledged: bool,
        expected: Expected | None,
        began: float,
    ) -> Said:
        """Compare the state with that after the change or, if it was not acknowledged, before it.

        A request that has not changed the state is made again, and must.
        """
        while (answer := await client.get("/readyz")).status_code != 200:
            if time.monotonic() > began + READY_SECONDS:
                return {"faults": [f"not ready: {answer.text}"]}
            await asyncio.sleep(0.01)
        said: Said = {"ready_seconds": time.monotonic() - began, "faults": []}
        await finished(client, JOB_SECONDS)
        now = said["state"] = await state(client, self.place, backups=bool(change.command))
        if expected is None:
            return said
        if now not in expected[acknowledged:]:
            wanted = expected[acknowledged]
            differs = [
                f"{key}: {value}, not {wanted[key]}" for key, value in now.items() if value != wanted[key]
            ]
            said["faults"].append(f"{'acknowledged and lost' if acknowledged else 'half there'}: {differs}")
        elif now == expected.before and change.request is not None:
            answer = await change.request(client)
            await finished(client, JOB_SECONDS)
            if not answer.is_success or await state(client, self.place) != expected.after:
                said["faults"].append(f"not possible afterwards: {answer.status_code} {answer.text}")
        return said
