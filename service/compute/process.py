"""One worker process, and calls to it."""

import multiprocessing
import resource
import signal
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from service.compute.worker import serve
from service.errors import TaskGivenUpError, TaskTimeLimitError, WorkerCrashedError, WorkerLostError

ASK_SECONDS = 0.25
# A process that has let go of its end is about to be over, though not at once on a busy machine.
END_SECONDS = 10.0
# What ends a process that has gone wrong in itself; whoever stops one sends another signal.
CRASHES = {signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL}

# Spawned, not forked: a fork of a process with threads may hold a lock that no one will ever release.
_spawn = multiprocessing.get_context("spawn")


class WorkerProcess:
    """A process that answers calls, one at a time; started when made. One thread calls, any may kill."""

    def __init__(self) -> None:
        self._connection: Connection[Any, Any]
        self._connection, theirs = _spawn.Pipe()
        self._process = _spawn.Process(target=serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        """Its process id."""
        assert self._process.pid is not None
        return self._process.pid

    def held(self) -> int:
        """Bytes that it holds in memory; 0 where the system does not tell."""
        try:
            return int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * resource.getpagesize()
        except OSError:
            return 0

    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def send(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Ask for `function(*arguments)`.

        Raises
        ------
        WorkerLostError
            The process had died, and has begun nothing.
        """
        try:
            self._connection.send((function, arguments))
        except OSError as error:
            raise WorkerLostError("the worker process had died") from error

    def receive(self, seconds: float, given_up: Callable[[], bool] = lambda: False) -> Any:  # noqa: ANN401
        """What the function returned there, or raised; `given_up` is asked now and then.

        Raises
        ------
        TaskTimeLimitError
            It took longer than `seconds`, and may still go on; or it used up its processor time, and is over.
        TaskGivenUpError
            No one waits for it any more; it may still go on.
        WorkerLostError
            The process died.
        """
        end = time.monotonic() + seconds
        try:
            while not self._connection.poll(max(0.0, min(ASK_SECONDS, end - time.monotonic()))):
                if time.monotonic() >= end:
                    raise TaskTimeLimitError(f"the work took longer than the limit of {seconds:g} s")
                if given_up():
                    raise TaskGivenUpError("no one waits for the work any more")
            done, answer = self._connection.recv()
        except (EOFError, OSError) as error:
            self._process.join(END_SECONDS)
            if self._process.exitcode == -signal.SIGXCPU:
                raise TaskTimeLimitError("the work took more processor time than the limit") from error
            if -(self._process.exitcode or 0) in CRASHES:
                raise WorkerCrashedError("the worker process broke down over the work") from error
            raise WorkerLostError("the worker process died before it had answered; try again") from error
        if not done:
            raise answer
        return answer

    def kill(self) -> None:
        """Stop it at once, so that the thread that waits for it hears of its death."""
        self._process.kill()

    def end(self) -> None:
        """Stop it at once, and let go of it: it holds nothing that is worth keeping."""
        self._process.kill()
        self._process.join()
        self._connection.close()
