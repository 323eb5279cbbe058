"""One place of a pool: a thread, and the worker process that it hands tasks to."""

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import Any

from service.compute.process import WorkerProcess
from service.compute.worker_startup import Starting
from service.errors import TaskGivenUpError, TaskTimeLimitError, WorkerCrashedError, WorkerLostError
from service.observability.logging import get_logger

log = get_logger("compute")

RESTART_SECONDS = 1.0
# Three times what a warm process needs. Memory that is free, but in pieces, is not given back by itself.
HELD_BYTES = 768 * 1024**2
# About what a new process takes to start.
GIVEN_UP_SECONDS = 2.0
# The next process is started when the one at work has so large a share of its tasks left.
AHEAD = 0.1
CAUSES = {
    WorkerLostError: "died",
    WorkerCrashedError: "died",
    TaskTimeLimitError: "time-limit",
    TaskGivenUpError: "given-up",
}


class Task(Future[Any]):
    """A call, and the future of its answer.

    It lets go of its arguments, which may be large, when a process has them, or when it is cancelled before.
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


class WorkerSlot(threading.Thread):
    """A place for one worker process at a time, and the thread that hands it tasks.

    `pid` is that of the process once it is warm; `busy` is whether it has a task.
    """

    def __init__(
        self,
        tasks: "SimpleQueue[Task | None]",
        closing: threading.Event,
        abandoned: threading.Event,
        seconds: float,
        warm: Callable[[], object],
        replaced: Callable[[str], object],
        tasks_each: int | None,
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
        self._tasks_each = tasks_each
        self._last_alone = tasks_each and tasks_each - max(1, round(AHEAD * tasks_each))
        self._tasks_done = 0
        self._process: WorkerProcess | None = None
        self._next: Starting | None = None

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
                self._drop_next()
                return
            if task.set_running_or_notify_cancel():
                self.busy = True
                self._do(task)
                self.busy = False
                self._renew()
            # Not kept until the next one comes: its arguments may be large.
            del task

    def _renew(self) -> None:
        """End a process that has done its share, or holds on to what a large task needed.

        The one that follows it is started before its share is done, so that the seat is hardly ever empty.
        """
        process = self._process
        if process is None:
            return
        if self._tasks_done == self._tasks_each or process.held() > HELD_BYTES:
            self._empty()
        elif self._next is None and self._tasks_done == self._last_alone:
            self._next = Starting(self._warm, self._abandoned)

    def stop_starting(self) -> None:
        """Do not wait for a process that is still warming up."""
        starting = self._next
        if starting is not None:
            starting.kill()

    def stop_working(self) -> None:
        """Do not wait for the task that is being done."""
        process = self._process
        if process is not None:
            process.kill()

    def _do(self, task: Task) -> None:
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
            self._tasks_done += 1
            task.set_exception(error)
        else:
            self._tasks_done += 1
            task.set_result(answer)

    def _hand_over(self, task: Task) -> WorkerProcess:
        """The process that has the task. One that died while idle had begun nothing, so another gets it."""
        process = self._process
        if process is not None and process.alive():
            try:
                process.send(task.function, task.arguments)
            except WorkerLostError:
                pass
            else:
                task.arguments = ()
                return process
        self._empty()
        if not self._fill() or self._process is None:
            raise WorkerLostError("no worker process could be started")
        self._process.send(task.function, task.arguments)
        task.arguments = ()
        return self._process

    def _fill(self) -> bool:
        """Put a warm process there; whether that succeeded."""
        if self._next is None:
            self._next = Starting(self._warm, self._abandoned)
        self._process = self._next.take()
        self._next = None
        if self._process is None:
            return False
        self._tasks_done = 0
        self.pid = self._process.pid
        return True

    def _drop_next(self) -> None:
        if self._next is not None:
            self._next.kill()
            process = self._next.take()
            if process is not None:
                process.end()

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
