"""The address of a service, and a service in a child process while a command lasts."""

import ipaddress
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Self

from service.client import Client
from service.errors import ExpectedError

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8000

SHUTDOWN_SECONDS = 10
"""How long a service that one command uses may take to stop; no request is left then."""

READY_SECONDS = 3600.0
"""How long a service may take to be ready: on a busy machine the first start compiles for many minutes."""


class PortError(ExpectedError):
    """The service cannot listen on the address; the message gives the reason."""

    status = 2


class StartError(ExpectedError):
    """The service did not start; the message gives the reason."""


def bind(host: str, port: int) -> socket.socket:
    """Bind a socket to the address, before a database is opened or migrated.

    Raise PortError if the port is in use, or the address is not one of this machine.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.socket(family, kind, protocol)
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
            # Until a process listens on the port, a second one can bind it.
            bound.listen(128)
        except BaseException:
            bound.close()
            raise
    except OSError as error:
        raise PortError(f"cannot listen on {host} port {port}: {error.strerror}") from error
    return bound


def is_loopback(address: str) -> bool:
    """Return whether only this machine can reach the address."""
    return ipaddress.ip_address(address).is_loopback


def wait_until_ready(client: Client, ended: Callable[[], bool]) -> None:
    """Return when the service is ready. On the first start its workers compile.

    Raise StartError if the service ended, or is not ready after an hour.
    """
    deadline = time.monotonic() + READY_SECONDS
    while not client.ready():
        if ended():
            raise StartError("the service ended before it was ready")
        if time.monotonic() > deadline:
            raise StartError(f"the service was not ready after {READY_SECONDS:.0f} s")
        time.sleep(0.1)


@contextmanager
def sigterm_exits() -> Iterator[None]:
    """Let SIGTERM interrupt as SIGINT does, then raise SystemExit. Only for the main thread.

    `asyncio.run` cancels its task at SIGINT. An exception that a handler raises in the midst of an event loop
    may be lost, or leave tasks that never end.
    """
    terminated = False

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        nonlocal terminated
        terminated = True
        signal.raise_signal(signal.SIGINT)

    previous = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        if not terminated:
            raise
    finally:
        signal.signal(signal.SIGTERM, previous)
    if terminated:
        raise SystemExit(128 + signal.SIGTERM)


class ChildService:
    """`isoshape serve` on a loopback port, with settings added to the environment.

    The process starts with the object and ends with its `with` block. `quiet`: its output is dropped.
    """

    def __init__(self, port: int, settings: Mapping[str, str], *, quiet: bool = False) -> None:
        # -P: files in the working folder are not part of the program.
        command = [sys.executable, "-P", "-m", "service.cli", "serve"]
        command += ["--host", LOOPBACK, "--port", str(port)]
        output = subprocess.DEVNULL if quiet else None
        self._process = subprocess.Popen(command, env=os.environ | settings, stdout=output, stderr=output)
        self.url = f"http://{LOOPBACK}:{port}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(2 * SHUTDOWN_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def ended(self) -> bool:
        """Return whether the process has ended."""
        return self._process.poll() is not None

    def memory(self) -> int:
        """Return the resident memory of the process in bytes, without its workers; on Linux."""
        status = Path(f"/proc/{self._process.pid}/status").read_text(encoding="ascii")
        (line,) = (line for line in status.splitlines() if line.startswith("VmRSS:"))
        return 1024 * int(line.split()[1])

    def processor_seconds(self) -> float:
        """Return the processor time that the process has used, without its workers; on Linux."""
        # The name of the program, in brackets, may have spaces.
        status = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="ascii")
        fields = status.rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def wait(self) -> int:
        """Wait for the end of the process, and return its exit status."""
        return self._process.wait()
