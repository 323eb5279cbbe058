"""Heavy work for requests: awaited, bounded in number, with errors of the service.

Executors do the work: processes on this machine, or a Dask cluster.
"""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable, Iterator
from concurrent.futures import Future
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, TypeVarTuple, Union

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from core.errors import CannotBeEmbeddedError, MalformedMeshError, MeshError, MeshTooComplexError
from core.io import Limits, MeshFile
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.pipeline import Pipeline
from service.compute import sandbox
from service.compute.compilation import COMPILING_SECONDS, is_compiled, warm_once_compiled
from service.compute.pool import LocalPool
from service.compute.processes import START_SECONDS
from service.compute.sandbox import (
    PartFile,
    largest_size,
    mesh_from_bytes,
    parts_from_bytes,
    read_file,
    read_part_files,
    read_zip_directory,
)
from service.compute.tasks import Embedded, embed_mesh
from service.errors import (
    CompilingError,
    FileTimeLimitError,
    ServiceError,
    TaskTimeLimitError,
    WorkerCrashedError,
    WorkerLostError,
)
from service.http.middleware import while_connected
from service.observability.logging import get_logger
from service.settings import Settings
from service.turns import Turns

if TYPE_CHECKING:
    from service.compute.cluster import ClusterPool

LOST_SECONDS = 30.0
"""How long a cancelled task may go on before it is cancelled again."""

Executor = Union[LocalPool, "ClusterPool"]
"""Runs tasks in other processes, reports its state and can be stopped at once."""


def start_executors(
    settings: Settings, parameters: Parameters, replaced: Callable[[str], object] = lambda cause: None
) -> tuple[Executor, LocalPool]:
    """Start workers, warmed up for these parameters, and readers of uploads.

    Workers may be those of a cluster. Readers are always confined processes on this machine. One more of each
    is for the place that `Turns` keeps for a client without any. `replaced` is called as by `LocalPool`.
    """
    workers: Executor
    if settings.scheduler:
        # Imported here: a service without a cluster needs no Dask.
        from service.compute.cluster import ClusterPool  # noqa: PLC0415

        workers = ClusterPool(
            settings.scheduler, parameters=parameters, seconds=settings.task_seconds, replaced=replaced
        )
    else:
        workers = LocalPool(
            settings.workers,
            more=1,
            seconds=settings.task_seconds,
            warm=partial(warm_once_compiled, parameters),
            start_seconds=START_SECONDS if is_compiled(parameters) else COMPILING_SECONDS,
            replaced=replaced,
        )
    readers = LocalPool(
        settings.workers,
        more=1,
        seconds=settings.task_seconds,
        warm=partial(sandbox.enter, settings.read_memory_bytes),
        replaced=replaced,
        tasks_each=sandbox.FILES_EACH,
        answer_bytes=largest_size(settings.limits),
    )
    readers.submit(sandbox.confinement).add_done_callback(_log_confinement)
    return workers, readers


def _log_confinement(answer: "Future[dict[str, bool]]") -> None:
    """Log whether the system confines the readers."""
    if answer.cancelled():
        return
    if answer.exception() is not None:
        log.warning("it is unknown whether this system confines readers of uploads: %s", answer.exception())
        return
    missing = [name for name, holds in answer.result().items() if not holds]
    if missing:
        log.warning(
            "this system does not confine readers of uploads by %s: a hostile file that takes over native "
            "code may open files or connections",
            " and ".join(missing),
        )
    else:
        log.info("readers of uploads are confined by Landlock and seccomp")


log = get_logger("compute")

LOOK_SECONDS = 0.25
"""The time between two looks of a thread that waits for a reader."""

PATIENCE_SECONDS, ROOM_SECONDS = 5.0, 0.02
"""The longest wait of work beside requests for a worker, and the time between two looks."""

Arguments = TypeVarTuple("Arguments")
Result = TypeVar("Result")


class ActivityGate:
    """Counts running requests, so that background work can wait until there are none; for one event loop."""

    def __init__(self) -> None:
        self._count = 0
        self._idle = asyncio.Event()
        self._idle.set()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Count one request for the duration of the block."""
        self._count += 1
        self._idle.clear()
        try:
            yield
        finally:
            self._count -= 1
            if not self._count:
                self._idle.set()

    async def until_idle(self) -> None:
        """Wait until no request runs."""
        await self._idle.wait()


async def together(works: Iterable[Coroutine[Any, Any, Result]]) -> list[Result]:
    """Run coroutines at a time and return their results; the first error ends the others and is raised.

    A cancellation goes before an error, where that of a task group may be lost.
    """
    tasks = [asyncio.create_task(work) for work in works]
    if not tasks:
        return []
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        task.result()
    return [task.result() for task in tasks]


async def whole(work: Awaitable[Result]) -> Result:
    """Return the result of work in a thread; a cancellation waits for its end: it may use the database."""
    task = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(task)
    except asyncio.CancelledError:
        await asyncio.wait([task])
        raise


async def end(task: asyncio.Task[None]) -> None:
    """Cancel a task and wait until it ends; a cancellation that a library loses is repeated."""
    while not task.done():
        task.cancel()
        await asyncio.wait([task], timeout=LOST_SECONDS)


@dataclass(eq=False)
class RequestQueue:
    """Reading, embedding and comparing shapes in worker processes, the requests of each client in turn.

    `readers` read files, within `limits` and `read_seconds` of processor time, in processes that
    `sandbox.enter` has confined; `executor` runs all else. `workers` requests are at work and `length` may
    wait; one more of each is for a client that has none. `compiling` returns whether no worker can start
    before the kernels are compiled.
    """

    executor: Executor
    readers: Executor
    limits: Limits
    read_seconds: float
    workers: int
    length: int = 0
    compiling: Callable[[], bool] = lambda: False

    def __post_init__(self) -> None:
        self._requests = Turns(self.workers, room=self.workers + self.length)
        self._tasks, self._readings = Turns(self.workers), Turns(self.workers)
        self._stopped = threading.Event()

    @property
    def room(self) -> int:
        """The largest number of requests that may be at work or wait."""
        return self.workers + self.length

    @property
    def inside(self) -> int:
        """The number of requests that are at work or wait."""
        return self._requests.inside

    async def until_spare(self, active: Callable[[], int], own: Callable[[], int]) -> None:
        """Wait for a worker that no request needs, nor the `active` files of the caller.

        Requests have priority, but who has no `own` file at work waits no longer than `PATIENCE_SECONDS`.
        """
        since = time.monotonic()
        while self.inside + active() >= self.workers:
            if not own() and time.monotonic() - since > PATIENCE_SECONDS:
                return
            await asyncio.sleep(ROOM_SECONDS)

    @asynccontextmanager
    async def admitted(self, request: Request) -> AsyncIterator[None]:
        """Wait for the turn of a request, which is at work for the duration of the block.

        Raise BusyError if `room` requests run or wait already, or the request has given way to that of
        another client, ClientDisconnect if the client disconnected, and CompilingError if no worker can start
        yet.
        """
        if self.compiling():
            raise CompilingError
        place = self._requests.ask()
        try:
            if not place.held:
                await while_connected(request, place)
            yield
        finally:
            self._requests.leave(place)

    async def embed(self, data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        """Read a file and embed its mesh."""
        with _at_fault():
            file, milliseconds = await self._reading(data, format)
            arguments = file.mesh, pipeline.parameters, milliseconds, file.warnings
            work = _in_turn(self._tasks, self.executor, embed_mesh, *arguments)
            # The mesh goes once a worker has it.
            del file, arguments
            return await work

    async def compare(self, function: Callable[[*Arguments], Result], *arguments: *Arguments) -> Result:
        """Call a function on stored embeddings in a worker; too little memory is no fault of the request."""
        with short_of_memory(), _failures_logged():
            return await _in_turn(self._tasks, self.executor, function, *arguments)

    async def read(self, data: bytes, format: str) -> Mesh:
        """Read the mesh of a file."""
        with _at_fault():
            return (await self._reading(data, format))[0].mesh

    async def parts(self, data: bytes, format: str) -> list[PartFile]:
        """Read the distinct parts of an assembly; none if the file has one part only."""
        with _at_fault():
            answer = await self._from_reader(read_part_files, data, format)
            return await run_in_threadpool(parts_from_bytes, answer, self.limits.distinct_parts)

    def zip_directory(self, end: bytes, size: int, most: int) -> bytes:
        """Return `sandbox.zip_directory(end, size, most)` of a confined process; it blocks.

        Raise MeshTooComplexError, ValueError or MemoryError if the directory is too long, or is none, and
        TaskTimeLimitError or WorkerLostError if reading took too long, or its process ended.
        `stop` cancels it.
        """
        reading = self.readers.submit(read_zip_directory, end, size, most, self.read_seconds)
        while not reading.done():
            with suppress(TimeoutError):
                reading.exception(LOOK_SECONDS)
            if self._stopped.is_set():
                reading.cancel()
        return bytes(reading.result())

    def stop(self) -> None:
        """Let threads wait for no reader any more, for the end of the service."""
        self._stopped.set()

    async def do(self, function: Callable[[*Arguments], Result], *arguments: *Arguments) -> Result:
        """Call a function, which the workers import by its name, in a worker."""
        with _at_fault():
            return await _in_turn(self._tasks, self.executor, function, *arguments)

    async def _reading(self, data: bytes, format: str) -> tuple[MeshFile, float]:
        return await run_in_threadpool(mesh_from_bytes, await self._from_reader(read_file, data, format))

    async def _from_reader(
        self, read: Callable[[bytes, str, Limits, float], bytes], data: bytes, format: str
    ) -> bytes:
        """Read a file in a confined process, whose answer is not trusted."""
        try:
            return await _in_turn(
                self._readings, self.readers, read, data, format, self.limits, self.read_seconds
            )
        except WorkerCrashedError as error:
            # Another attempt would end another reader, so the client is not told to try again.
            raise MalformedMeshError("the reader of such files broke down over this one") from error
        except (MeshError, MemoryError, ServiceError):
            raise
        except Exception as error:
            # A reader is not trusted, and may send any error that the service knows.
            log.error("a reader failed on a file", exc_info=error)
            raise MalformedMeshError("the reader of such files failed on this one") from error


async def _in_turn(
    turns: Turns, executor: Executor, function: Callable[[*Arguments], Result], *arguments: *Arguments
) -> Result:
    """Call a function in an executor when it is the turn of the client."""
    loop, place = asyncio.get_running_loop(), turns.ask()

    def leave(_task: object) -> None:
        # Nothing waits for a turn after the end of the loop.
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(turns.leave, place)

    try:
        await place
        task = executor.submit(function, *arguments)
    except BaseException:
        turns.leave(place)
        raise
    # A cancelled task has its process for some time yet.
    task.add_done_callback(leave)
    del arguments
    return await asyncio.wrap_future(task)


@contextmanager
def _at_fault() -> Iterator[None]:
    """Refuse a file that takes too much time or memory."""
    try:
        with _failures_logged():
            yield
    except TaskTimeLimitError as error:
        raise FileTimeLimitError(str(error)) from error
    except MemoryError as error:
        raise MeshTooComplexError("the mesh takes more memory than there is") from error


@contextmanager
def _failures_logged() -> Iterator[None]:
    """Log the failure of the method on a mesh: the client learns only that it failed."""
    try:
        yield
    except CannotBeEmbeddedError as error:
        log.error("the method failed on a mesh", exc_info=error)
        raise


@contextmanager
def short_of_memory() -> Iterator[None]:
    """Turn a lack of memory over stored shapes into an error of the service, not of the request.

    Raise WorkerLostError in the place of MemoryError.
    """
    try:
        yield
    except MemoryError as error:
        raise WorkerLostError("a worker has too little memory now; try again") from error
