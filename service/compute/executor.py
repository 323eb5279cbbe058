"""The interface of executors, and the choice of one: processes on this machine, or a Dask cluster."""

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, Protocol

from core.parameters import Parameters
from service.compute import sandbox
from service.compute.compilation import COMPILING_SECONDS, is_compiled, warm_once_compiled
from service.compute.pool import LocalPool, WorkerCounts
from service.compute.processes import START_SECONDS
from service.compute.reader_answers import largest_size
from service.observability.logging import get_logger
from service.settings import Settings

log = get_logger("compute")


class Executor(Protocol):
    """Runs tasks in other processes, reports its state and can be stopped at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:  # noqa: ANN401
        """Call `fn(*args)` in a worker. Function, arguments and result must pickle."""

    def ready(self) -> bool:
        """Return whether a worker is available."""

    def pids(self) -> list[int]:
        """Return the process ids of the warm workers, each on its machine."""

    def counts(self) -> WorkerCounts:
        """Return the numbers of workers by their state, and of waiting tasks."""

    def kill(self) -> None:
        """Shut down at once, without waiting for running tasks."""


def start_executors(
    settings: Settings, parameters: Parameters, replaced: Callable[[str], object] = lambda cause: None
) -> tuple[Executor, LocalPool]:
    """Start workers, warmed up for these parameters, and readers of uploads.

    Workers may be those of a cluster. Readers are always confined processes on this machine. `replaced` is
    called as by `LocalPool`.
    """
    workers: Executor
    if settings.scheduler:
        # Imported here: a service without a cluster needs no Dask.
        from service.compute.cluster import ClusterPool  # noqa: PLC0415

        workers = ClusterPool(
            settings.scheduler, parameters=parameters, seconds=settings.task_seconds, replaced=replaced
        )
    else:
        workers = LocalPool(
            settings.workers,
            seconds=settings.task_seconds,
            warm=partial(warm_once_compiled, parameters),
            start_seconds=START_SECONDS if is_compiled(parameters) else COMPILING_SECONDS,
            replaced=replaced,
        )
    readers = LocalPool(
        settings.workers,
        seconds=settings.task_seconds,
        warm=partial(sandbox.enter, settings.read_memory_bytes),
        replaced=replaced,
        tasks_each=sandbox.FILES_EACH,
        answer_bytes=largest_size(settings.limits),
    )
    readers.submit(sandbox.confinement).add_done_callback(_log_confinement)
    return workers, readers


def _log_confinement(answer: "Future[dict[str, bool]]") -> None:
    """Log whether the system confines the readers."""
    if answer.cancelled():
        return
    if answer.exception() is not None:
        log.warning("it is unknown whether this system confines readers of uploads: %s", answer.exception())
        return
    missing = [name for name, holds in answer.result().items() if not holds]
    if missing:
        log.warning(
            "this system does not confine readers of uploads by %s: a hostile file that takes over native "
            "code may open files or connections",
            " and ".join(missing),
        )
    else:
        log.info("readers of uploads are confined by Landlock and seccomp")
