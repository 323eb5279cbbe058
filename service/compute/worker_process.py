"""One worker process, and calls to it."""

import resource
import signal
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from service.compute.fork_server import fork_server
from service.compute.plain_answers import LARGEST, AnswerFormError, decode
from service.compute.worker_loop import serve
from service.errors import TaskGivenUpError, TaskTimeLimitError, WorkerCrashedError, WorkerLostError

ASK_SECONDS = 0.25
# A process that has closed its end of the pipe ends soon, but on a busy machine not at once.
END_SECONDS = 10.0
# A worker that stands still so long, as a debugger or an operator may have it, is replaced.
STOPPED_SECONDS = 5.0
# Signals of a process that crashes by itself; a process that is stopped gets another signal.
CRASHES = {signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL}


class WorkerProcess:
    """A process that answers one call at a time. One thread calls; any thread may kill the process.

    Parameters
    ----------
    untrusted : bool
        Whether nothing that the process sends is unpickled: see `service.compute.plain_answers`.
    """

    def __init__(self, *, untrusted: bool = False) -> None:
        self._untrusted = untrusted
        self._connection: Connection[Any, Any]
        context = fork_server()
        self._connection, theirs = context.Pipe()
        self._process = context.Process(
            target=serve, args=(theirs,), kwargs={"untrusted": untrusted}, daemon=True
        )
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        """The process id."""
        assert self._process.pid is not None
        return self._process.pid

    def held(self) -> int:
        """Resident memory of the process in bytes; 0 on systems without /proc."""
        try:
            return int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * resource.getpagesize()
        except OSError:
            return 0

    def stopped(self) -> bool:
        """Whether the process stands still by a signal, or under a debugger; False without /proc."""
        try:
            # The state follows the name, which is in brackets and may hold anything.
            return Path(f"/proc/{self.pid}/stat").read_bytes().rpartition(b") ")[2][:1] in {b"T", b"t"}
        except OSError:
            return False

    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def send(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Start the call `function(*arguments)`.

        Raises
        ------
        WorkerLostError
            The process was dead, and the call has not begun.
        """
        try:
            self._connection.send((function, arguments))
        except OSError as error:
            raise WorkerLostError("the worker process had died") from error

    def receive(self, seconds: float, given_up: Callable[[], bool] = lambda: False) -> Any:  # noqa: ANN401
        """Return the result of the call, or raise its error; `given_up` is polled meanwhile.

        Raises
        ------
        TaskTimeLimitError
            The call took longer than `seconds` and may still run; or it used up its processor time and ended.
        TaskGivenUpError
            The caller has cancelled the call, which may still run.
        WorkerLostError
            The process died, or stands still.
        """
        going = time.monotonic()
        end = going + seconds
        try:
            while not self._connection.poll(max(0.0, min(ASK_SECONDS, end - time.monotonic()))):
                if time.monotonic() >= end:
                    raise TaskTimeLimitError(f"the work took longer than the limit of {seconds:g} s")
                if not self.stopped():
                    going = time.monotonic()
                elif time.monotonic() > going + STOPPED_SECONDS:
                    raise WorkerLostError("the worker process was stopped; try again")
                if given_up():
                    raise TaskGivenUpError("no one waits for the work any more")
            if self._untrusted:
                received: Any = self._connection.recv_bytes(LARGEST)
            else:
                received = self._connection.recv()
        except (EOFError, OSError) as error:
            self._process.join(END_SECONDS)
            if self._process.exitcode == -signal.SIGXCPU:
                raise TaskTimeLimitError("the work took more processor time than the limit") from error
            if -(self._process.exitcode or 0) in CRASHES:
                raise WorkerCrashedError("the worker process broke down over the work") from error
            raise WorkerLostError("the worker process died before it had answered; try again") from error
        if self._untrusted:
            return self._decoded(received)
        done, answer = received
        if not done:
            raise answer
        return answer

    def _decoded(self, answer: bytes) -> Any:  # noqa: ANN401
        try:
            return decode(answer)
        except AnswerFormError as error:
            raise WorkerCrashedError("the worker process sent no answer") from error

    def kill(self) -> None:
        """Kill the process; the thread that waits for an answer sees its death."""
        self._process.kill()

    def end(self) -> None:
        """Kill the process and release its resources."""
        self._process.kill()
        self._process.join()
        self._connection.close()
