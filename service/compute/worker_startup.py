"""A worker process on its way: started, and warmed before anyone gives it a task."""

import threading
from collections.abc import Callable

from service.compute.process import WorkerProcess
from service.observability.logging import get_logger

log = get_logger("compute")

START_SECONDS = 180.0


class Starting(threading.Thread):
    """The thread that starts a process and warms it.

    Parameters
    ----------
    warm : callable
        Called in the new process; what it returns is dropped.
    abandoned : threading.Event
        Set when no process is wanted any more.
    """

    def __init__(self, warm: Callable[[], object], abandoned: threading.Event) -> None:
        super().__init__(daemon=True, name="isoshape-starting")
        self._warm = warm
        self._abandoned = abandoned
        self._process: WorkerProcess | None = None
        self._warmed = False
        self._killed = False
        self.start()

    def run(self) -> None:
        """Start the process and wait until it is warm."""
        if self._unwanted():
            return
        try:
            self._process = WorkerProcess()
            # Whoever wants it no more now sees the process and kills it; whoever did before, did not.
            if self._unwanted():
                self._process.kill()
            self._process.send(self._warm, ())
            self._process.receive(START_SECONDS)
        except Exception as error:
            if not self._unwanted():
                log.error("a worker process could not be started", exc_info=error)
        else:
            self._warmed = True

    def take(self) -> WorkerProcess | None:
        """Wait for the process, which is the caller's then; None if it could not be started."""
        self.join()
        if self._warmed:
            return self._process
        if self._process is not None:
            self._process.end()
        return None

    def kill(self) -> None:
        """Do not wait for a process that is still warming up."""
        self._killed = True
        if self._process is not None:
            self._process.kill()

    def _unwanted(self) -> bool:
        return self._killed or self._abandoned.is_set()
