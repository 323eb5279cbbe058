"""The memory of a service and its children over time."""

import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.service.processes import children

MIB = 1024 * 1024
PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Growth:
    """The trend of resident memory after the warm-up.

    Attributes
    ----------
    first, last, most : float
        MiB; the first and last are medians of a tenth of the samples.
    slope : float
        MiB a minute, by least squares.
    """

    first: float
    last: float
    most: float
    slope: float


class Watch(threading.Thread):
    """Reads the memory of a process, and of its children together, every few seconds until stopped."""

    def __init__(self, pid: int, seconds: float = 2.0) -> None:
        super().__init__(daemon=True)
        self._pid = pid
        self._seconds = seconds
        self._done = threading.Event()
        self.samples: list[tuple[float, float, float]] = []

    def run(self) -> None:
        """Read until stopped."""
        start = time.monotonic()
        while not self._done.wait(self._seconds):
            own, theirs = resident(self._pid), sum(map(resident, children(self._pid)))
            self.samples.append((time.monotonic() - start, own, theirs))

    def stop(self) -> None:
        """Read no more."""
        self._done.set()
        self.join()

    def growth(self, warm_up: float) -> tuple[Growth, Growth]:
        """The trends of the process and of its children, from so many seconds on."""
        kept = np.array([sample for sample in self.samples if sample[0] >= warm_up])
        return growth(kept[:, 0], kept[:, 1]), growth(kept[:, 0], kept[:, 2])


def growth(seconds: np.ndarray, mib: np.ndarray) -> Growth:
    """The trend of a series; shape (n,) each, n at least 2."""
    tenth = max(1, len(mib) // 10)
    return Growth(
        first=float(np.median(mib[:tenth])),
        last=float(np.median(mib[-tenth:])),
        most=float(mib.max()),
        slope=float(np.polyfit(seconds / 60.0, mib, 1)[0]),
    )


def resident(pid: int) -> float:
    """MiB in memory; 0 for a process that has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE / MIB
    except (OSError, IndexError):
        return 0.0
