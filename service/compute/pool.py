"""An executor that survives the death of its worker processes.

The standard process pool breaks for good when a worker dies, fails every task in flight, and cannot stop a
slow task. Here each worker process has a thread that hands it one task at a time through a pipe of its own. A
process that dies, or is killed at the time limit, costs one task, and a new process replaces it.
`docs/architecture.md` says what other pools lack.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from queue import Empty, SimpleQueue
from typing import Any

from service.compute.worker_slot import Task, WorkerSlot
from service.compute.worker_startup import START_SECONDS
from service.compute.workers_interface import Workers
from service.errors import WorkerLostError

PING_SECONDS = 2.0


class LocalPool(Workers):
    """Worker processes on this machine.

    Parameters
    ----------
    workers : int
        The number of processes.
    seconds : float
        The time limit of a task. The pool then kills the process, and the future raises
        `TaskTimeLimitError`.
    warm : callable
        Called in each new process before its first task; the result is dropped.
    start_seconds : float
        The longest time that `warm` may take; a process that exceeds it is replaced.
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
        seconds: float,
        warm: Callable[[], object],
        start_seconds: float = START_SECONDS,
        replaced: Callable[[str], object] = lambda cause: None,
        tasks_each: int | None = None,
        answer_bytes: int | None = None,
    ) -> None:
        self._tasks: SimpleQueue[Task | None] = SimpleQueue()
        self._closing = threading.Event()
        self._abandoned = threading.Event()
        self._submitting = threading.Lock()
        self._slots = [
            WorkerSlot(
                self._tasks,
                self._closing,
                self._abandoned,
                seconds,
                warm,
                replaced,
                tasks_each,
                start_seconds=start_seconds,
                answer_bytes=answer_bytes,
            )
            for _ in range(workers)
        ]
        for slot in self._slots:
            slot.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Call `fn(*args)` in a worker. Function, arguments and result must pickle; no keywords.

        A running call can be cancelled too: the pool replaces its process unless the call ends shortly.
        """
        if kwargs:
            raise TypeError("tasks take positional arguments only")
        task = Task(fn, args)
        with self._submitting:
            if self._closing.is_set():
                raise RuntimeError("the pool is shut down")
            self._tasks.put(task)
        return task

    def ready(self) -> bool:
        """Whether a worker is available: an idle or a new worker answers, or a living worker is busy."""
        if any((slot.pid is not None and not slot.busy) or slot.renewing for slot in self._slots):
            ping = self.submit(os.getpid)
            try:
                return ping.result(PING_SECONDS) is not None
            except (TimeoutError, WorkerLostError, CancelledError):
                ping.cancel()
        return any(slot.busy and slot.pid is not None for slot in self._slots)

    def pids(self) -> list[int]:
        """The process ids of the warm workers."""
        return [slot.pid for slot in self._slots if slot.pid is not None]

    def idle(self) -> int:
        """The number of warm workers without a task."""
        return sum(slot.pid is not None and not slot.busy for slot in self._slots)

    def busy(self) -> int:
        """The number of workers with a task."""
        return sum(slot.pid is not None and slot.busy for slot in self._slots)

    def starting(self) -> int:
        """The number of workers that are not warm yet."""
        return sum(slot.pid is None for slot in self._slots)

    def waiting(self) -> int:
        """The number of tasks in the queue."""
        return self._tasks.qsize()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more tasks, finish the accepted tasks (with `cancel_futures`, the running ones), end."""
        with self._submitting:
            self._closing.set()
        if cancel_futures:
            self._abandoned.set()
            self._cancel_waiting()
            for slot in self._slots:
                slot.stop_starting()
        for _ in self._slots:
            self._tasks.put(None)
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
                task = self._tasks.get_nowait()
            except Empty:
                return
            if task is not None:
                task.cancel()
