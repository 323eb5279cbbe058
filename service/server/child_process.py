"""The service in a child process, while a command lasts."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import Self

from service.server.address import LOOPBACK
from service.server.uvicorn_server import SHUTDOWN_SECONDS


@contextmanager
def sigterm_exits() -> Iterator[None]:
    """Let SIGTERM raise SystemExit, so that `with` blocks clean up. Only for the main thread."""

    def leave(number: int, _frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class ChildService:
    """`isoshape serve` on a loopback port.

    The process starts with the object and ends with its `with` block.

    Parameters
    ----------
    port : int
    settings : mapping
        Variables added to the environment.
    quiet : bool
        Whether the output of the process is dropped.
    """

    def __init__(self, port: int, settings: Mapping[str, str], *, quiet: bool = False) -> None:
        # -P: files in the working folder are not part of the program.
        command = [
            sys.executable,
            "-P",
            "-m",
            "service.cli",
            "serve",
            "--host",
            LOOPBACK,
            "--port",
            str(port),
        ]
        output = subprocess.DEVNULL if quiet else None
        self._process = subprocess.Popen(command, env=os.environ | settings, stdout=output, stderr=output)
        self.url = f"http://{LOOPBACK}:{port}"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(2 * SHUTDOWN_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def ended(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def memory(self) -> int:
        """The resident memory of the process in bytes, without its workers; on Linux."""
        status = Path(f"/proc/{self._process.pid}/status").read_text(encoding="ascii")
        (line,) = (line for line in status.splitlines() if line.startswith("VmRSS:"))
        return 1024 * int(line.split()[1])

    def processor_seconds(self) -> float:
        """The processor time that the process has used, without its workers; on Linux."""
        # The name of the program, in brackets, may have spaces.
        status = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="ascii")
        fields = status.rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def wait(self) -> int:
        """Wait for the end of the process; its exit status."""
        return self._process.wait()
