"""An executor of worker processes that outlives any of them.

The standard process pool breaks for good when one of its workers dies, fails every task in flight with it,
and cannot stop a task that takes too long. Here each worker process has a thread that hands it one task at a
time, so that a process which dies, or is killed at the time limit, costs one task and is replaced.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from queue import Empty, SimpleQueue
from typing import Any

from service.compute.worker_slot import Task, WorkerSlot
from service.compute.workers import Workers
from service.errors import WorkerLostError

PING_SECONDS = 2.0


class LocalPool(Workers):
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
    tasks_each : int or None
        A process is replaced, while none waits for it, after so many tasks; None is never.
    """

    def __init__(
        self,
        workers: int,
        *,
        seconds: float,
        warm: Callable[[], object],
        replaced: Callable[[str], object] = lambda cause: None,
        tasks_each: int | None = None,
    ) -> None:
        self._tasks: SimpleQueue[Task | None] = SimpleQueue()
        self._closing = threading.Event()
        self._abandoned = threading.Event()
        self._submitting = threading.Lock()
        self._seats = [
            WorkerSlot(self._tasks, self._closing, self._abandoned, seconds, warm, replaced, tasks_each)
            for _ in range(workers)
        ]
        for slot in self._seats:
            slot.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Have `fn(*args)` called in a worker. Function, arguments and result must pickle; no keywords.

        The future may be cancelled while the call is made: its process is replaced unless it ends shortly.
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
        """Whether a worker can be had: an idle one answers, or one is alive and at work."""
        if any(slot.pid is not None and not slot.busy for slot in self._seats):
            ping = self.submit(os.getpid)
            try:
                return ping.result(PING_SECONDS) is not None
            except (TimeoutError, WorkerLostError, CancelledError):
                ping.cancel()
        return any(slot.busy and slot.pid is not None for slot in self._seats)

    def pids(self) -> list[int]:
        """The process ids of the workers that are warm."""
        return [slot.pid for slot in self._seats if slot.pid is not None]

    def idle(self) -> int:
        """How many workers have no task."""
        return sum(slot.pid is not None and not slot.busy for slot in self._seats)

    def busy(self) -> int:
        """How many workers have one."""
        return sum(slot.pid is not None and slot.busy for slot in self._seats)

    def starting(self) -> int:
        """How many are not warm yet."""
        return sum(slot.pid is None for slot in self._seats)

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
            for slot in self._seats:
                slot.stop_starting()
        for _ in self._seats:
            self._tasks.put(None)
        if wait:
            for slot in self._seats:
                slot.join()
            self._cancel_waiting()

    def kill(self) -> None:
        """Shut down at once: what was begun raises `WorkerLostError`, what was not is cancelled."""
        self.shutdown(wait=False, cancel_futures=True)
        for slot in self._seats:
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
