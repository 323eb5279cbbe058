"""Worker processes: the fork server that starts them, and one process and calls to it."""

import multiprocessing
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext, SpawnContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType
from typing import Any

from service.compute.worker_loop import THREADS, decode, serve
from service.errors import TaskGivenUpError, TaskTimeLimitError, WorkerCrashedError, WorkerLostError
from service.settings import PREFIX

LOADED = ["service.compute.warm_start", "trimesh"]
"""The modules of the tasks; trimesh is otherwise imported when the first STL, PLY or GLB is written."""

START_SECONDS = 180.0
ASK_SECONDS = 0.25
# Idle processes take a call at once; the largest takes a second.
SEND_SECONDS = 30.0
# A process that has closed its end of the pipe ends soon, but on a busy machine not at once.
END_SECONDS = 10.0
# A worker or fork server that stands still so long, as a debugger or an operator may have it, is replaced.
STOPPED_SECONDS = 5.0
# Signals of a process that crashes by itself; a process that is stopped gets another signal.
CRASHES = {signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL}

_starting = threading.Lock()


@contextmanager
def _environment_of_workers() -> Iterator[None]:
    """Have the environment that the fork server inherits if it starts during the block; one block at a time.

    Libraries read the number of threads when they load, in the fork server. Settings may be secrets, and
    readers of hostile files are its children.
    """
    with _starting:
        own = {name for name in os.environ if name in THREADS or name.upper().startswith(PREFIX)}
        kept = {name: os.environ.pop(name) for name in own}
        os.environ.update(dict.fromkeys(THREADS, "1"))
        try:
            yield
        finally:
            for name in THREADS:
                del os.environ[name]
            os.environ.update(kept)


def fork_server() -> ForkServerContext | SpawnContext:
    """Start the fork server if it does not run, and return the context that starts worker processes.

    The service itself is not forked: the fork of a process with threads may inherit a lock that is never
    released. A fresh process for each worker would load the tasks again, which takes a second. Systems
    without fork servers start fresh processes.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    with _environment_of_workers():
        context.set_forkserver_preload(LOADED)
        forkserver.ensure_running()
    return context


@contextmanager
def _without_main_module() -> Iterator[None]:
    """Have processes that start during the block not import the program that runs the service.

    The import may take seconds, and readers of hostile files have no use for it. Tasks are functions of
    other modules.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def is_stopped(pid: int) -> bool:
    """Return whether a signal or a debugger has stopped a process; False without /proc."""
    try:
        # The state follows the name, which is in brackets and may hold anything.
        return Path(f"/proc/{pid}/stat").read_bytes().rpartition(b") ")[2][:1] in {b"T", b"t"}
    except OSError:
        return False


@contextmanager
def _fork_server_goes_on() -> Iterator[None]:
    """Kill the fork server if it stands still during the block, which waits for it; the next is a new one.

    The fork server sends the process ids of new processes, and the exit codes of ended ones.
    """
    over = threading.Event()

    def watch() -> None:
        going = time.monotonic()
        while not over.wait(ASK_SECONDS):
            pid = getattr(forkserver._forkserver, "_forkserver_pid", None)
            if pid is None or not is_stopped(pid):
                going = time.monotonic()
            elif time.monotonic() > going + STOPPED_SECONDS:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def _started(arguments: dict[str, Any]) -> BaseProcess:
    """Start a process with arguments of `multiprocessing.Process`; a dead fork server is replaced."""
    for tries_left in reversed(range(3)):
        process = fork_server().Process(**arguments, daemon=True)
        try:
            # A fork server that has just died is started again by this call.
            with _environment_of_workers(), _without_main_module(), _fork_server_goes_on():
                process.start()
        except (EOFError, OSError) as error:
            if not tries_left:
                raise WorkerLostError("the fork server died") from error
        else:
            return process
    raise AssertionError


class WorkerProcess:
    """A process that answers one call at a time. One thread calls; any thread may kill the process.

    `started` is the time of its start, of `time.monotonic`. A process with `answer_bytes` is not trusted:
    nothing that it sends is unpickled (`worker_loop.decode`), and its answers have at most so many bytes.
    """

    def __init__(self, *, answer_bytes: int | None = None) -> None:
        self._answer_bytes = answer_bytes
        self._connection: Connection[Any, Any]
        self._connection, theirs = multiprocessing.Pipe()
        arguments = {"target": serve, "args": (theirs,), "kwargs": {"untrusted": answer_bytes is not None}}
        with theirs:
            try:
                self._process = _started(arguments)
            except BaseException:
                self._connection.close()
                raise
        self.started = time.monotonic()

    @property
    def pid(self) -> int:
        """The process id."""
        assert self._process.pid is not None
        return self._process.pid

    def resident_bytes(self) -> int:
        """Return the resident memory of the process in bytes; 0 on systems without /proc."""
        try:
            return int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * resource.getpagesize()
        except OSError:
            return 0

    def alive(self) -> bool:
        """Return whether the process runs."""
        return self._process.is_alive()

    def send(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Start the call `function(*arguments)`.

        Raise WorkerLostError if the process was dead or takes no call, and the call has not begun.
        """
        try:
            with self._killed_after(SEND_SECONDS):
                self._connection.send((function, arguments))
        except OSError as error:
            raise WorkerLostError("the worker process had died") from error

    def receive(self, seconds: float, given_up: Callable[[], bool] = lambda: False) -> Any:  # noqa: ANN401
        """Return the result of the call, or raise its error; `given_up` is polled meanwhile.

        Raise TaskTimeLimitError if the call took longer than `seconds` and may still run, or used up its
        processor time and ended; TaskGivenUpError if the caller has cancelled it, which may still run; and
        WorkerLostError if the process died, stands still, or sent no answer.
        """
        going = time.monotonic()
        end = going + seconds
        try:
            while not self._connection.poll(max(0.0, min(ASK_SECONDS, end - time.monotonic()))):
                if time.monotonic() >= end:
                    raise TaskTimeLimitError(f"the work took longer than the limit of {seconds:g} s")
                if not is_stopped(self.pid):
                    going = time.monotonic()
                elif time.monotonic() > going + STOPPED_SECONDS:
                    raise WorkerLostError("the worker process was stopped; try again")
                if given_up():
                    raise TaskGivenUpError("no one waits for the work any more")
            # The process may stop in the middle of its answer.
            with self._killed_after(end - time.monotonic()):
                if self._answer_bytes is not None:
                    received: Any = self._connection.recv_bytes(self._answer_bytes)
                else:
                    received = self._connection.recv()
        except (EOFError, OSError) as error:
            late = time.monotonic() >= end
            self._process.join(END_SECONDS)
            if late:
                raise TaskTimeLimitError(f"the answer took longer than the limit of {seconds:g} s") from error
            if self._process.exitcode == -signal.SIGXCPU:
                raise TaskTimeLimitError("the work took more processor time than the limit") from error
            # A process that goes on has sent no answer of the allowed size.
            if self._process.exitcode is None or -self._process.exitcode in CRASHES:
                raise WorkerCrashedError("the worker process broke down over the work") from error
            raise WorkerLostError("the worker process died before it had answered; try again") from error
        if self._answer_bytes is not None:
            return decode(received)
        done, answer = received
        if not done:
            raise answer
        return answer

    @contextmanager
    def _killed_after(self, seconds: float) -> Iterator[None]:
        """Kill the process if the block takes longer: a read or a write of the pipe then fails."""
        timer = threading.Timer(seconds, self.kill)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def kill(self) -> None:
        """Kill the process; the thread that waits for an answer sees its death."""
        self._process.kill()

    def end(self) -> None:
        """Kill the process and release its resources."""
        self._process.kill()
        # Without a thread, in the usual case.
        self._process.join(ASK_SECONDS)
        with nullcontext() if self._process.exitcode is not None else _fork_server_goes_on():
            self._process.join()
        self._connection.close()
