"""Tasks that worker processes import by name."""

import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from core.errors import EmptyFileError
from core.mesh.mesh import Mesh
from core.numerics.guarding import guarded
from service.compute import tasks
from service.compute.pool import LocalPool
from service.compute.tasks import Embedded, embed_mesh
from service.compute.worker_loop import THREADS


def warm() -> None:
    """Do nothing."""


def times_warmed_up() -> int:
    """The number of pipelines that this process is warm for."""
    return tasks.warm.cache_info().currsize


def fail_to_warm() -> None:
    """Raise."""
    raise OSError("no warmth today")


def hang_second(folder: str) -> None:
    """Do nothing, but never end in the second process that has the folder."""
    number = len(list(Path(folder).iterdir()))
    Path(folder, str(number)).touch()
    if number == 1:
        time.sleep(600)


def add(a: int, b: int) -> int:
    """The sum."""
    return a + b


def nap(seconds: float) -> None:
    """Sleep."""
    time.sleep(seconds)


def meet(mine: str, *others: str) -> None:
    """Leave a file, and wait for those of other tasks."""
    Path(mine).touch()
    while not all(Path(other).exists() for other in others):
        time.sleep(0.01)


def pid_at_meeting(mine: str, *others: str) -> int:
    """Wait for all other tasks and return the process id: tasks that meet are in slots of their own."""
    meet(mine, *others)
    return os.getpid()


def nap_instead(*_arguments: object) -> None:
    """Sleep longer than any limit in the tests, whatever was asked."""
    time.sleep(600)


def break_down_over_cube(mesh: Mesh, *arguments: Any) -> Embedded:
    """Embed a mesh; over a cube, end the process as a fault of memory does."""
    if len(mesh.vertices) == 8:
        os.kill(os.getpid(), signal.SIGSEGV)
    return embed_mesh(mesh, *arguments)


def embed_unless_cube(mesh: Mesh, *arguments: Any) -> Embedded:
    """Embed a mesh; over a cube, sleep longer than any limit in the tests."""
    if len(mesh.vertices) == 8:
        time.sleep(600)
    return embed_mesh(mesh, *arguments)


def napping(pool: LocalPool) -> int | None:
    """The process that has `nap_instead` to run, which a request's earlier tasks may precede."""
    for slot in pool._slots:
        task = slot.task
        if task is not None and task.function is nap_instead and not task.arguments:
            return slot.pid
    return None


def refuse(message: str) -> None:
    """Raise one of the core's errors."""
    raise EmptyFileError(message)


def fail_unexpectedly(*_arguments: object) -> None:
    """Fail as the method does over a mesh that it was not made for, whatever was asked."""
    with guarded():
        np.log(np.zeros(1))


def die() -> None:
    """End this process as the kernel would when memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)


def return_a_lock() -> object:
    """An object that does not pickle."""
    return threading.Lock()


class OddError(Exception):
    """An error that cannot be made from its message alone, so that it does not unpickle."""

    def __init__(self, one: int, two: int) -> None:
        super().__init__(f"{one} and {two}")


def raise_oddly() -> None:
    """Raise an error that does not unpickle."""
    raise OddError(1, 2)


def environment() -> dict[str, object]:
    """The argument that the worker was given."""
    return {"pid": os.getpid(), "threads": {name: os.environ[name] for name in THREADS}}


def run_out_of_memory(*_arguments: object) -> bytes:
    """Ask for more memory than there is, whatever was asked."""
    return bytes(1 << 62)


def serve_until_killed() -> None:
    """The work of a process that is to be killed: it gives two workers long tasks, and prints their ids."""
    pool = LocalPool(2, seconds=600, warm=warm)
    for future in [pool.submit(nap, 600) for _ in range(2)]:
        while not future.running():
            time.sleep(0.01)
    print(*pool.pids(), flush=True)
    time.sleep(600)


def holds_the_network() -> tuple[bool, int]:
    """Return whether this process has loaded the library that runs the network, and its threads."""
    return "libonnxruntime" in Path("/proc/self/maps").read_text(), len(os.listdir("/proc/self/task"))
