"""An executor of worker processes that survives the death of one.

The standard process pool breaks for good when a worker dies, fails every task in flight, and cannot stop a
slow task. Here each worker process has a thread that hands it one task at a time through a pipe of its own. A
process that dies, or is killed at the time limit, costs one task, and a new process replaces it.
`docs/architecture.md` says what other pools lack.
"""

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

from service.compute.processes import START_SECONDS, WorkerProcess
from service.errors import TaskGivenUpError, TaskTimeLimitError, WorkerCrashedError, WorkerLostError
from service.observability.logging import get_logger

log = get_logger("compute")

PING_SECONDS = 2.0
RESTART_SECONDS = 1.0
# Three times the memory of a warm process. Fragmented free memory does not return to the system by itself.
MEMORY_BYTES = 768 * 1024**2
# About the time that a new process takes to start.
GIVEN_UP_SECONDS = 2.0
# The next process starts when the current process has this share of its tasks left.
AHEAD = 0.1
CAUSES = {
    WorkerLostError: "died",
    WorkerCrashedError: "died",
    TaskTimeLimitError: "time-limit",
    TaskGivenUpError: "given-up",
}


@dataclass(frozen=True)
class WorkerCounts:
    """Numbers of workers that could start a task at once, that have one and that are not warm yet.

    `waiting` is the number of tasks that no worker has taken yet.
    """

    idle: int
    busy: int
    starting: int
    waiting: int


class Task(Future[Any]):
    """A call, and the future of its result.

    A task drops its arguments, which may be large, once a process has them or the task is cancelled. A
    running call that is cancelled may go on for `GIVEN_UP_SECONDS`: a new process costs more than a short
    call.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        super().__init__()
        self.function = function
        self.arguments = arguments
        self._given_up_at: float | None = None

    def cancel(self) -> bool:
        """Cancel a queued call and return True; mark a running call as given up and return False."""
        if super().cancel():
            self.arguments = ()
            return True
        if self._given_up_at is None:
            self._given_up_at = time.monotonic()
        return False

    def given_up(self) -> bool:
        """Return whether the call was cancelled more than `GIVEN_UP_SECONDS` ago."""
        return self._given_up_at is not None and time.monotonic() >= self._given_up_at + GIVEN_UP_SECONDS


class WorkerSlot(threading.Thread):
    """A slot for one worker process at a time, and the thread that hands it tasks.

    `pid` is the process id of a warm process, else None; `task` is what the process has or is handed, else
    None; `renewing` says whether a new process is about to replace one that has run its number of tasks. The
    first process runs `phase` fewer tasks than others.
    """

    def __init__(self, pool: "LocalPool", phase: int) -> None:
        super().__init__(daemon=True, name="isoshape-worker")
        self.pid: int | None = None
        self.task: Task | None = None
        self.renewing = False
        self._pool = pool
        each = pool.tasks_each
        self._last_alone = each and each - max(1, round(AHEAD * each))
        self._tasks_done, self._phase = 0, phase
        self._has_turn = False
        self._process: WorkerProcess | None = None
        self._next: WorkerProcess | None = None

    @property
    def busy(self) -> bool:
        """Whether the process has a task."""
        return self.task is not None

    def run(self) -> None:
        """Run tasks until the end of the queue."""
        while True:
            if self._process is None and not self._fill():
                if self._pool.closing.is_set() or self._pool.leaves(self):
                    return
                self._refuse_one()
                self._pool.closing.wait(RESTART_SECONDS)
                continue
            task = self._pool.tasks.get()
            if task is None:
                self._empty()
                if self._next is not None:
                    self._next.end()
                return
            if task.set_running_or_notify_cancel():
                self.task = task
                self._do(task)
                self.task = None
                self._renew()
            # Dropped before the next task comes: its result may be large.
            del task

    def _renew(self) -> None:
        """End a process that has run its number of tasks, or holds more memory than `MEMORY_BYTES`.

        The next process starts before the current process has run all its tasks, so the slot is rarely empty;
        one slot of the pool at a time has a next process, which bounds the memory of all.
        """
        process = self._process
        if process is None:
            return
        if self._tasks_done == self._pool.tasks_each or process.resident_bytes() > MEMORY_BYTES:
            self.renewing = True
            self._empty()
        elif self._last_alone and self._tasks_done >= self._last_alone and self._next is None:
            self._has_turn = self._pool.starting_ahead.acquire(blocking=False)
            if self._has_turn:
                self._start_next()

    def stop_working(self) -> None:
        """Kill the process with its running task."""
        process = self._process
        if process is not None:
            process.kill()

    def _do(self, task: Task) -> None:
        """Run the task and settle its future."""
        try:
            process = self._hand_over(task)
            answer = process.receive(self._pool.seconds, task.given_up)
        except (WorkerLostError, TaskTimeLimitError) as error:
            log.warning("a worker process is replaced: %s", error)
            self._pool.replaced(CAUSES[type(error)])
            self._empty()
            task.set_exception(error)
        except Exception as error:
            self._tasks_done += 1
            task.set_exception(error)
        else:
            self._tasks_done += 1
            task.set_result(answer)

    def _hand_over(self, task: Task) -> WorkerProcess:
        """Send the task to the process, or to a new process if the process died idle; return the process."""
        process = self._process
        if process is not None and process.alive():
            with suppress(WorkerLostError):
                process.send(task.function, task.arguments)
                task.arguments = ()
                return process
        self._empty()
        if not self._fill() or self._process is None:
            raise WorkerLostError("no worker process could be started")
        self._process.send(task.function, task.arguments)
        task.arguments = ()
        return self._process

    def _fill(self) -> bool:
        """Fill the slot with a warm process; return whether one started."""
        if self._next is None and not self._pool.abandoned.is_set():
            self._start_next()
        if self._next is not None:
            try:
                # A process that was started ahead has had most of its time, and has answered unless it hangs.
                left = self._next.started + self._pool.start_seconds - time.monotonic()
                self._next.receive(max(left, RESTART_SECONDS), self._pool.abandoned.is_set)
            except Exception as error:
                self._end_next(error)
            else:
                self._process, self._next = self._next, None
                self._tasks_done, self._phase = self._phase, 0
                self._end_turn()
                self.pid = self._process.pid
        self.renewing = False
        return self._process is not None

    def _start_next(self) -> None:
        """Start the next process, which warms up by itself."""
        try:
            self._next = WorkerProcess(answer_bytes=self._pool.answer_bytes)
            self._next.send(self._pool.warm, ())
        except Exception as error:
            self._end_next(error)

    def _end_next(self, error: Exception) -> None:
        """End a process that cannot be used, and log why unless the pool has given it up."""
        if not isinstance(error, TaskGivenUpError):
            known = isinstance(error, WorkerLostError | TaskTimeLimitError)
            log.error("a worker process could not be started: %s", error, exc_info=None if known else error)
        if self._next is not None:
            self._next.end()
            self._next = None
        self._end_turn()

    def _end_turn(self) -> None:
        """Let another slot start its next process ahead."""
        if self._has_turn:
            self._has_turn = False
            self._pool.starting_ahead.release()

    def _empty(self) -> None:
        self.pid = None
        if self._process is not None:
            self._process.end()
            self._process = None

    def _refuse_one(self) -> None:
        """Fail one queued task, since no process starts: requests must not wait for ever."""
        try:
            task = self._pool.tasks.get_nowait()
        except Empty:
            return
        if task is None:
            self._pool.tasks.put(None)
        elif task.set_running_or_notify_cancel():
            task.set_exception(WorkerLostError("no worker process could be started"))


class LocalPool(Executor):
    """Worker processes on this machine.

    Parameters
    ----------
    workers : int
        The number of processes.
    more : int
        The number of further processes, each of which starts when all others have a task.
    seconds : float
        The time limit of a task. The pool then kills the process, and the future raises
        `TaskTimeLimitError`.
    warm : callable
        Called in each new process before its first task; the result is dropped.
    start_seconds : float
        The longest time from the start of a process to the end of `warm`; a process that exceeds it is
        replaced.
    replaced : callable
        Called in a thread of the pool whenever a task causes the replacement of its process, with the cause:
        "died", "time-limit" or "given-up".
    tasks_each : int or None
        The number of tasks after which a new process, already warm, replaces an old one; None for no limit.
    answer_bytes : int, optional
        The processes are not trusted: their results are bytes, at most so many, or values of JSON.
    """

    def __init__(
        self,
        workers: int,
        *,
        more: int = 0,
        seconds: float,
        warm: Callable[[], object],
        start_seconds: float = START_SECONDS,
        replaced: Callable[[str], object] = lambda cause: None,
        tasks_each: int | None = None,
        answer_bytes: int | None = None,
    ) -> None:
        self.seconds = seconds
        self.warm = warm
        self.start_seconds = start_seconds
        self.replaced = replaced
        self.tasks_each = tasks_each
        self.answer_bytes = answer_bytes
        self.tasks: SimpleQueue[Task | None] = SimpleQueue()
        self.closing = threading.Event()
        self.abandoned = threading.Event()
        self.starting_ahead = threading.Lock()
        self._submitting = threading.Lock()
        self._unfinished = 0
        self._workers, self._most = workers, workers + more
        self._slots: list[WorkerSlot] = []
        for _ in range(workers):
            self._add_slot()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Call `fn(*args)` in a worker. Function, arguments and result must pickle; no keywords.

        A running call can be cancelled too: the pool replaces its process unless the call ends shortly.
        """
        if kwargs:
            raise TypeError("tasks take positional arguments only")
        task = Task(fn, args)
        with self._submitting:
            if self.closing.is_set():
                raise RuntimeError("the pool is shut down")
            self._unfinished += 1
            if len(self._slots) < min(self._unfinished, self._most):
                self._add_slot()
            self.tasks.put(task)
        task.add_done_callback(self._count_down)
        return task

    def _count_down(self, _task: Future[Any]) -> None:
        with self._submitting:
            self._unfinished -= 1

    def leaves(self, slot: WorkerSlot) -> bool:
        """Remove a slot whose process cannot start if it is a further one; return whether it is."""
        with self._submitting:
            if len(self._slots) <= self._workers or self.closing.is_set():
                return False
            self._slots.remove(slot)
            return True

    def _add_slot(self) -> None:
        # The slots are spread over the number of tasks after which each is renewed.
        slot = WorkerSlot(self, len(self._slots) * (self.tasks_each or 0) // self._most)
        self._slots.append(slot)
        slot.start()

    def ready(self) -> bool:
        """Return whether a worker is available: an idle or new worker answers, or a living one is busy."""
        if any((slot.pid is not None and not slot.busy) or slot.renewing for slot in self._slots):
            ping = self.submit(os.getpid)
            try:
                return ping.result(PING_SECONDS) is not None
            except (TimeoutError, WorkerLostError, CancelledError):
                ping.cancel()
        return any(slot.busy and slot.pid is not None for slot in self._slots)

    def pids(self) -> list[int]:
        """Return the process ids of the warm workers."""
        return [slot.pid for slot in self._slots if slot.pid is not None]

    def counts(self) -> WorkerCounts:
        """Return the numbers of workers by their state, and of the tasks in the queue."""
        busy = [slot.busy for slot in self._slots if slot.pid is not None]
        return WorkerCounts(
            busy.count(False), sum(busy), len(self._slots) - len(busy), waiting=self.tasks.qsize()
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more tasks, finish the accepted tasks (with `cancel_futures`, the running ones), end."""
        with self._submitting:
            self.closing.set()
        if cancel_futures:
            self.abandoned.set()
            self._cancel_waiting()
        for _ in self._slots:
            self.tasks.put(None)
        if wait:
            for slot in self._slots:
                slot.join()
            self._cancel_waiting()

    def kill(self) -> None:
        """Shut down at once: running tasks raise `WorkerLostError`, queued tasks are cancelled."""
        self.shutdown(wait=False, cancel_futures=True)
        for slot in self._slots:
            slot.stop_working()
        self.shutdown(wait=True, cancel_futures=True)

    def _cancel_waiting(self) -> None:
        while True:
            try:
                task = self.tasks.get_nowait()
            except Empty:
                return
            if task is not None:
                task.cancel()
