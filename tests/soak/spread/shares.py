"""Who used the processors meanwhile."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import psutil

from tests.service import engines

ROLES = {"service.cli": "service", "dask_scheduler": "scheduler", "dask_worker": "workers"}


@dataclass
class Shares:
    """Wall time in seconds, and processor time by role in processors: 1 is one that is busy all the time."""

    seconds: float = 0.0
    busy: dict[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        return ", ".join(f"{role} {share:.2f}" for role, share in self.busy.items())


@contextmanager
def shares() -> Iterator[Shares]:
    """Filled in at the end of the block; what processes used that ended meanwhile is lost."""
    found, before, began = Shares(), _used(), time.perf_counter()
    yield found
    found.seconds = time.perf_counter() - began
    after = _used()
    for role in (*ROLES.values(), "database", "client"):
        used = sum(after[role, pid] - before.get((role, pid), 0.0) for each, pid in after if each == role)
        found.busy[role] = used / found.seconds


def _used() -> dict[tuple[str, int], float]:
    """Seconds of processor time by role and process."""
    me = psutil.Process()
    trees = [("database", psutil.Process(engines.server().get_pid()))]
    for child in me.children():
        command = " ".join(child.cmdline())
        trees += [(role, child) for part, role in ROLES.items() if part in command]
    found = {("client", me.pid): _seconds(me)}
    for role, tree in trees:
        for process in (tree, *tree.children(recursive=True)):
            try:
                found[role, process.pid] = _seconds(process)
            except psutil.NoSuchProcess:
                continue
    return found


def _seconds(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
