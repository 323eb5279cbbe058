"""An executor of worker processes that outlives any of them.

The standard process pool breaks for good when one of its workers dies, fails every task in flight with it,
and cannot stop a task that takes too long. Here each worker process has a thread that hands it one task at a
time, so that a process which dies, or is killed at the time limit, costs one task and is replaced.
"""

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from queue import Empty, SimpleQueue
from typing import Any

from service.compute.process import WorkerProcess
from service.errors import TaskGivenUpError, TaskTimeLimitError, WorkerLostError
from service.logging import get_logger

log = get_logger("compute")

START_SECONDS = 180.0
RESTART_SECONDS = 1.0
PING_SECONDS = 2.0
# About what a new process takes to start.
GIVEN_UP_SECONDS = 2.0
CAUSES = {WorkerLostError: "died", TaskTimeLimitError: "time-limit", TaskGivenUpError: "given-up"}


class _Task(Future[Any]):
    """A call, and the future of its answer.

    Cancelled before it is begun, it lets go of its arguments at once, though its place in the queue stays.
    Cancelled later it may go on for a while, since ending the process costs more than a short call.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        super().__init__()
        self.function = function
        self.arguments = arguments
        self._given_up_at: float | None = None

    def cancel(self) -> bool:
        """Whether the call will not be made; one that is being made is given up."""
        if super().cancel():
            self.arguments = ()
            return True
        if self._given_up_at is None:
            self._given_up_at = time.monotonic()
        return False

    def given_up(self) -> bool:
        """Whether it has had its time since it was cancelled."""
        return self._given_up_at is not None and time.monotonic() >= self._given_up_at + GIVEN_UP_SECONDS


class LocalPool(Executor):
    """Worker processes on this machine.

    Parameters
    ----------
    workers : int
        How many.
    seconds : float
        The longest a task may run. Its process is then killed and its future raises `TaskTimeLimitError`.
    warm : callable
        Called in each new process before it takes a task; what it returns is dropped.
    replaced : callable
        Told, in a thread of the pool, whenever a process is replaced because of its task, and why: "died",
        "time-limit" or "given-up".
    """

    def __init__(
        self,
        workers: int,
        *,
        seconds: float,
        warm: Callable[[], object],
        replaced: Callable[[str], object] = lambda cause: None,
    ) -> None:
        self._tasks: SimpleQueue[_Task | None] = SimpleQueue()
        self._closing = threading.Event()
        self._abandoned = threading.Event()
        self._submitting = threading.Lock()
        self._seats = [
            _Seat(self._tasks, self._closing, self._abandoned, seconds, warm, replaced)
            for _ in range(workers)
        ]
        for seat in self._seats:
            seat.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Have `fn(*args)` called in a worker. Function, arguments and result must pickle; no keywords.

        The future may be cancelled while the call is made: its process is replaced unless it ends shortly.
        """
        if kwargs:
            raise TypeError("tasks take positional arguments only")
        task = _Task(fn, args)
        with self._submitting:
            if self._closing.is_set():
                raise RuntimeError("the pool is shut down")
            self._tasks.put(task)
        return task

    def ready(self) -> bool:
        """Whether a worker can be had: an idle one answers, or one is alive and at work."""
        if any(seat.pid is not None and not seat.busy for seat in self._seats):
            ping = self.submit(os.getpid)
            try:
                return ping.result(PING_SECONDS) is not None
            except (TimeoutError, WorkerLostError, CancelledError):
                ping.cancel()
        return any(seat.busy and seat.pid is not None for seat in self._seats)

    def pids(self) -> list[int]:
        """The process ids of the workers that are warm."""
        return [seat.pid for seat in self._seats if seat.pid is not None]

    def idle(self) -> int:
        """How many workers have no task."""
        return sum(seat.pid is not None and not seat.busy for seat in self._seats)

    def busy(self) -> int:
        """How many workers have one."""
        return sum(seat.pid is not None and seat.busy for seat in self._seats)

    def starting(self) -> int:
        """How many are not warm yet."""
        return sum(seat.pid is None for seat in self._seats)

    def waiting(self) -> int:
        """How many tasks no worker has taken yet."""
        return self._tasks.qsize()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; finish those given, or, to cancel them, only those begun; end the processes."""
        with self._submitting:
            self._closing.set()
        if cancel_futures:
            self._abandoned.set()
            self._cancel_waiting()
            for seat in self._seats:
                seat.stop_starting()
        for _ in self._seats:
            self._tasks.put(None)
        if wait:
            for seat in self._seats:
                seat.join()
            self._cancel_waiting()

    def kill(self) -> None:
        """Shut down at once: what was begun raises `WorkerLostError`, what was not is cancelled."""
        self.shutdown(wait=False, cancel_futures=True)
        for seat in self._seats:
            seat.stop_working()
        self.shutdown(wait=True, cancel_futures=True)

    def _cancel_waiting(self) -> None:
        while True:
            try:
                task = self._tasks.get_nowait()
            except Empty:
                return
            if task is not None:
                task.cancel()


class _Seat(threading.Thread):
    """A place for one worker process at a time, and the thread that hands it tasks.

    `pid` is that of the process once it is warm; `busy` is whether it has a task.
    """

    def __init__(
        self,
        tasks: "SimpleQueue[_Task | None]",
        closing: threading.Event,
        abandoned: threading.Event,
        seconds: float,
        warm: Callable[[], object],
        replaced: Callable[[str], object],
    ) -> None:
        super().__init__(daemon=True, name="isoshape-worker")
        self.pid: int | None = None
        self.busy = False
        self._tasks = tasks
        self._closing = closing
        self._abandoned = abandoned
        self._seconds = seconds
        self._warm = warm
        self._replaced = replaced
        self._process: WorkerProcess | None = None

    def run(self) -> None:
        """Do tasks until the end of the queue."""
        while True:
            if self._process is None and not self._fill():
                if self._closing.is_set():
                    return
                self._refuse_one()
                self._closing.wait(RESTART_SECONDS)
                continue
            task = self._tasks.get()
            if task is None:
                self._empty()
                return
            if task.set_running_or_notify_cancel():
                self.busy = True
                self._do(task)
                self.busy = False
            # Not kept until the next one comes: its arguments may be large.
            del task

    def stop_starting(self) -> None:
        """Do not wait for a process that is still warming up."""
        process = self._process
        if self.pid is None and process is not None:
            process.kill()

    def stop_working(self) -> None:
        """Do not wait for the task that is being done."""
        process = self._process
        if process is not None:
            process.kill()

    def _do(self, task: _Task) -> None:
        """Have the task done and its future settled."""
        try:
            process = self._hand_over(task)
            answer = process.receive(self._seconds, task.given_up)
        except (WorkerLostError, TaskTimeLimitError) as error:
            log.warning("a worker process is replaced: %s", error)
            self._replaced(CAUSES[type(error)])
            self._empty()
            task.set_exception(error)
        except Exception as error:
            task.set_exception(error)
        else:
            task.set_result(answer)

    def _hand_over(self, task: _Task) -> WorkerProcess:
        """The process that has the task. One that died while idle had begun nothing, so another gets it."""
        process = self._process
        if process is not None and process.alive():
            try:
                process.send(task.function, task.arguments)
            except WorkerLostError:
                pass
            else:
                return process
        self._empty()
        if not self._fill() or self._process is None:
            raise WorkerLostError("no worker process could be started")
        self._process.send(task.function, task.arguments)
        return self._process

    def _fill(self) -> bool:
        """Start a process and warm it; whether that succeeded."""
        if self._abandoned.is_set():
            return False
        try:
            self._process = WorkerProcess()
            # Whoever abandons the pool now sees the process and kills it; whoever did before, did not.
            if self._abandoned.is_set():
                self._process.kill()
            self._process.send(self._warm, ())
            self._process.receive(START_SECONDS)
        except Exception as error:
            if not self._abandoned.is_set():
                log.error("a worker process could not be started", exc_info=error)
            self._empty()
            return False
        self.pid = self._process.pid
        return True

    def _empty(self) -> None:
        self.pid = None
        if self._process is not None:
            self._process.end()
            self._process = None

    def _refuse_one(self) -> None:
        """No process starts: let waiting requests have an answer rather than wait for ever."""
        try:
            task = self._tasks.get_nowait()
        except Empty:
            return
        if task is None:
            self._tasks.put(None)
        elif task.set_running_or_notify_cancel():
            task.set_exception(WorkerLostError("no worker process could be started"))
