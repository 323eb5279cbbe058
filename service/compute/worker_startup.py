"""The start of a worker process: the process is warm before its first task."""

import threading
from collections.abc import Callable

from service.compute.worker_process import WorkerProcess
from service.errors import TaskTimeLimitError, WorkerLostError
from service.observability.logging import get_logger

log = get_logger("compute")

START_SECONDS = 180.0


class Starting(threading.Thread):
    """A thread that starts and warms one process.

    Parameters
    ----------
    warm : callable
        Called in the new process; the result is dropped.
    abandoned : threading.Event
        Set when the pool wants no process any more.
    seconds : float
        The longest time that `warm` may take.
    answer_bytes : int or None
        As for `WorkerProcess`.
    """

    def __init__(
        self,
        warm: Callable[[], object],
        abandoned: threading.Event,
        *,
        seconds: float,
        answer_bytes: int | None,
    ) -> None:
        super().__init__(daemon=True, name="isoshape-starting")
        self._warm = warm
        self._abandoned = abandoned
        self._seconds = seconds
        self._answer_bytes = answer_bytes
        self._process: WorkerProcess | None = None
        self._warmed = False
        self._killed = False
        self.start()

    def run(self) -> None:
        """Start the process and wait until `warm` has returned."""
        if self._unwanted():
            return
        try:
            self._process = WorkerProcess(answer_bytes=self._answer_bytes)
            # A call of `kill` from now on sees the process; an earlier call did not.
            if self._unwanted():
                self._process.kill()
            self._process.send(self._warm, ())
            self._process.receive(self._seconds)
        except (WorkerLostError, TaskTimeLimitError) as error:
            if not self._unwanted():
                log.error("a worker process could not be started: %s", error)
        except Exception as error:
            if not self._unwanted():
                log.error("a worker process could not be started", exc_info=error)
        else:
            self._warmed = True

    def take(self) -> WorkerProcess | None:
        """Wait for the process and hand it to the caller; None if it did not start."""
        self.join()
        if self._warmed:
            return self._process
        if self._process is not None:
            self._process.end()
        return None

    def kill(self) -> None:
        """Kill the process, or do not start it."""
        self._killed = True
        if self._process is not None:
            self._process.kill()

    def _unwanted(self) -> bool:
        return self._killed or self._abandoned.is_set()
