"""The memory that a service and its workers hold, and its growth."""

import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import psutil

MIB = 1024 * 1024
Measure = Callable[[psutil.Process], float]
Summary = Callable[[Iterable[float]], float]


def resident(process: psutil.Process) -> float:
    """MiB of a process, those that it shares included."""
    return process.memory_info().rss / MIB


def proportional(process: psutil.Process) -> float:
    """MiB of a process; what processes share is divided among them."""
    return process.memory_full_info().pss / MIB


def memory(pid: int, measure: Measure = resident, summary: Summary = sum) -> tuple[float, float]:
    """MiB of a service, and the sum of its readers and workers, without those that have just ended."""
    service, workers = psutil.Process(pid), [0.0]
    for process in service.children(recursive=True):
        with suppress(psutil.Error):
            workers.append(measure(process))
    return measure(service), summary(workers)


class Watch:
    """Measures the memory of a service now and again while a block runs.

    Attributes
    ----------
    samples : list of tuple
        Seconds since the start, MiB of the service, MiB of its workers: their sum or another summary.
    """

    def __init__(
        self, pid: int, *, every_seconds: float, measure: Measure = resident, summary: Summary = sum
    ) -> None:
        self.samples: list[tuple[float, float, float]] = []
        self._over = threading.Event()
        arguments = (pid, every_seconds, measure, summary)
        self._thread = threading.Thread(target=self._run, args=arguments, daemon=True)

    def __enter__(self) -> "Watch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self, pid: int, every_seconds: float, measure: Measure, summary: Summary) -> None:
        start, over = time.monotonic(), False
        while not over:
            self.samples.append((time.monotonic() - start, *memory(pid, measure, summary)))
            over = self._over.wait(every_seconds)


class Growth(NamedTuple):
    """MiB: medians of the first and last tenth of the samples, the most, and a minute by least squares."""

    first: float
    last: float
    most: float
    slope: float


def growth(seconds: np.ndarray, mib: np.ndarray) -> Growth:
    """The trend of a series; shape (n,) each, n at least 2."""
    tenth = max(1, len(mib) // 10)
    return Growth(
        first=float(np.median(mib[:tenth])),
        last=float(np.median(mib[-tenth:])),
        most=float(mib.max()),
        slope=float(np.polyfit(seconds / 60.0, mib, 1)[0]),
    )
