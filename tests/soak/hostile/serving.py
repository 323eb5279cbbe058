"""A service under hostile files, and the memory that it and its workers hold."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import httpx

from tests.service import processes
from tests.service.processes import children
from tests.soak.load.memory import resident

LIMIT_SECONDS = 180.0
"""The longest that a file may be worked on: the service's own limits of time are shorter together."""


@dataclass(frozen=True)
class Memory:
    """MiB that are resident; what processes share is counted for each.

    Attributes
    ----------
    service : float
        In the process that answers.
    workers : float
        In the processes that read files and embed, together.
    """

    service: float
    workers: float


@contextmanager
def server(folder: Path, **settings: str) -> Iterator[tuple[int, httpx.Client]]:
    """Yield the process id of a service on an archive in a folder, of two workers, and a client."""
    usual = {"ISOSHAPE_WORKERS": "2", "ISOSHAPE_LOG_LEVEL": "warning", **settings}
    with processes.server(folder, answer_seconds=LIMIT_SECONDS, **usual) as (process, client):
        yield process.pid, client


def memory(pid: int) -> Memory:
    """The resources that the service of a process id and its workers hold now."""
    return Memory(resident(pid), sum(map(resident, children(pid))))


class Peak:
    """The most MiB that a service and its workers hold at once, measured twenty times a second.

    What processes share is divided among them (proportional set size).
    """

    def __init__(self, pid: int) -> None:
        self.mib = _proportional(pid)
        self._pid = pid
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> "Peak":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(0.05):
            self.mib = max(self.mib, _proportional(self._pid))


def _proportional(pid: int) -> float:
    """The proportional set size of a process and its children, in MiB; a process that has ended counts 0."""
    total = 0
    for process in (pid, *children(pid)):
        with suppress(OSError, IndexError):
            total += int(Path(f"/proc/{process}/smaps_rollup").read_text().partition("Pss:")[2].split()[0])
    return total / 1024
