"""An executor on a Dask cluster, which may become unreachable and return.

Dask repeats the tasks of a lost worker on another worker. This module adds the rest: while the scheduler is
unreachable or has no workers, waiting tasks fail, and the executor tries to connect until it succeeds.
"""

import logging
import os
import pickle
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, InvalidStateError, wait
from contextlib import suppress
from functools import partial
from typing import Any

import dask
from distributed import Client, get_worker
from distributed.scheduler import KilledWorker

from core.parameters import Parameters
from service.compute.pool import LocalPool, WorkerCounts
from service.errors import ClusterUnavailableError, TaskTimeLimitError, WorkerLostError
from service.observability.logging import get_logger

log = get_logger("compute")

# Dask logs tracebacks; this module logs the same events in one line each.
logging.getLogger("distributed.client").setLevel(logging.CRITICAL)

LOOK_SECONDS = 0.5
CONNECT_SECONDS = 5.0
# Waiting tasks fail when the cluster has had no workers for this time.
PATIENCE_SECONDS = 10.0
# A thread of a worker looks so often whether its task has ended.
POLL_SECONDS = 0.25
# Without an answer of the scheduler, the connection may take so long to end.
END_SECONDS = 30.0

# Meshes pass through the scheduler, so that the loss of a worker loses no mesh.
dask.config.set({"distributed.admin.large-graph-warning-threshold": "4 GiB"})


class ClusterPool(Executor):
    """The workers of the Dask cluster whose scheduler has an address.

    Workers are warmed up for `parameters`. `seconds` and `replaced` are those of `LocalPool`; no cause is
    "given-up".
    """

    def __init__(
        self,
        address: str,
        *,
        parameters: Parameters,
        seconds: float,
        replaced: Callable[[str], object] = lambda cause: None,
    ) -> None:
        self._address = address
        self._parameters = parameters
        self._seconds = seconds
        self._replaced = replaced
        self._lock = threading.Lock()
        self._open: set[Future[Any]] = set()
        self._client: Client | None = None
        self._executor: Executor | None = None
        self._threads: dict[str, int] = {}
        self._warming: dict[str, Any] = {}
        self._pids: dict[str, int] = {}
        self._seen = time.monotonic()
        self._closing = threading.Event()
        self._watching = threading.Thread(target=self._watch, daemon=True, name="isoshape-cluster")
        self._watching.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401
        """Call `fn(*args)` in a worker. Function, arguments and result must pickle; no keywords.

        Raise ClusterUnavailableError if the scheduler is unreachable, or has no workers.
        """
        if kwargs:
            raise TypeError("tasks take positional arguments only")
        if self._closing.is_set():
            raise RuntimeError("the pool is shut down")
        executor = self._executor
        if executor is None or not self._threads:
            away = "scheduler cannot be reached" if executor is None else "scheduler has no workers"
            raise ClusterUnavailableError(f"the cluster's {away} now")
        remote = executor.submit(run, pickle.dumps((fn, args)), self._parameters, self._seconds)
        task: Future[Any] = Future()
        with self._lock:
            self._open.add(task)
        task.add_done_callback(lambda task: self._forget(task, remote))
        remote.add_done_callback(lambda remote: self._settle(task, remote))
        return task

    def ready(self) -> bool:
        """Return whether the cluster has a warm worker."""
        return bool(self._pids)

    def pids(self) -> list[int]:
        """Return the process ids of the warm workers, each on its machine."""
        return list(self._pids.values())

    def counts(self) -> WorkerCounts:
        """Return the counts of this service's tasks, as if no other service used the cluster."""
        threads, tasks = sum(self._threads.values()), len(self._open)
        return WorkerCounts(
            idle=max(0, threads - tasks),
            busy=min(threads, tasks),
            starting=len(self._threads.keys() - self._pids.keys()),
            waiting=max(0, tasks - threads),
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more tasks, wait for the accepted tasks or cancel them, and disconnect."""
        self._closing.set()
        with self._lock:
            tasks = list(self._open)
        for task in tasks:
            if cancel_futures:
                task.cancel()
            elif wait:
                with suppress(Exception):
                    task.result()
        if wait or cancel_futures:
            self._watching.join(END_SECONDS)

    def kill(self) -> None:
        """Disconnect at once: unfinished tasks raise `WorkerLostError`."""
        self._fail(WorkerLostError("the work was stopped"))
        self.shutdown(cancel_futures=True)

    def _watch(self) -> None:
        """Connect, and check the workers at intervals, until the shutdown."""
        while not self._closing.wait(LOOK_SECONDS):
            try:
                if self._client is None:
                    self._connect()
                elif self._client.status == "running":
                    self._look(self._client)
                else:
                    self._lose()
            except Exception as error:
                log.error("the cluster cannot be looked at", exc_info=error)
                self._lose()
        while self._open and self._client is not None and self._client.status == "running":
            time.sleep(LOOK_SECONDS)
        self._leave()

    def _connect(self) -> None:
        try:
            client = Client(self._address, timeout=CONNECT_SECONDS, set_as_default=False, name="isoshape")
        except (OSError, TimeoutError) as error:
            log.warning("the scheduler at %s cannot be reached: %s", self._address, error)
            return
        log.info("the scheduler is there", extra={"fields": {"address": self._address}})
        self._client, self._executor = client, client.get_executor(pure=False)
        self._seen = time.monotonic()
        self._look(client)

    def _look(self, client: Client) -> None:
        """Update the list of workers, and warm up the new ones."""
        assert client.scheduler is not None
        self._threads = client.sync(client.scheduler.ncores, callback_timeout=CONNECT_SECONDS)
        if self._threads:
            self._seen = time.monotonic()
        elif time.monotonic() - self._seen > PATIENCE_SECONDS:
            self._fail(ClusterUnavailableError("the cluster's scheduler has no workers now"))
        for address in self._threads.keys() - self._warming.keys():
            self._warming[address] = client.submit(
                warm_up, self._parameters, self._seconds, workers=[address], pure=False
            )
        for address in self._warming.keys() - self._threads.keys():
            self._warming.pop(address).cancel()
        warmed = {address: each for address, each in self._warming.items() if each.status == "finished"}
        # The result goes with a worker that is lost meanwhile.
        self._pids = {
            address: self._pids.get(address) or each.result(CONNECT_SECONDS)
            for address, each in warmed.items()
        }

    def _lose(self) -> None:
        """Fail all tasks: the scheduler may never answer."""
        self._executor = None
        self._fail(ClusterUnavailableError("the cluster's scheduler was lost; try again"))
        self._leave()

    def _leave(self) -> None:
        """Close the connection."""
        client, self._client, self._executor = self._client, None, None
        self._threads, self._warming, self._pids = {}, {}, {}
        if client is not None:
            with suppress(Exception):
                client.close(timeout=LOOK_SECONDS)

    def _fail(self, error: Exception) -> None:
        with self._lock:
            tasks = list(self._open)
        for task in tasks:
            _raise(task, error)

    def _forget(self, task: Future[Any], remote: Future[Any]) -> None:
        """Forget a task that has ended, and cancel it on the cluster if its caller cancelled it."""
        with self._lock:
            self._open.discard(task)
        remote.cancel()

    def _settle(self, task: Future[Any], remote: Future[Any]) -> None:
        """Set the result of a task, or an error of the service if the cluster has failed it."""
        if remote.cancelled():
            _raise(task, ClusterUnavailableError("the cluster's scheduler was lost; try again"))
            return
        error = remote.exception()
        if isinstance(error, KilledWorker):
            self._replaced("died")
            _raise(task, WorkerLostError("workers died before they had answered; try again"))
        elif error is not None:
            log.error("the cluster failed", exc_info=error)
            _raise(task, ClusterUnavailableError(f"the cluster failed: {type(error).__name__}"))
        else:
            try:
                done, answer = pickle.loads(remote.result())
            except Exception as error:
                done, answer = False, error
            if done:
                with suppress(InvalidStateError):
                    task.set_result(answer)
                return
            if isinstance(answer, WorkerLostError | TaskTimeLimitError):
                self._replaced("died" if isinstance(answer, WorkerLostError) else "time-limit")
            _raise(task, answer)


def _raise(task: Future[Any], error: BaseException) -> None:
    with suppress(InvalidStateError):
        task.set_exception(error)


# The rest runs on the workers of the cluster. Each worker hands tasks to processes of its own, so that a task
# that takes too long, or ends its process, costs that task and not the worker. Its threads only wait.

_pools: dict[float, LocalPool] = {}
_making = threading.Lock()


def run(payload: bytes, parameters: Parameters, seconds: float) -> bytes:
    """Call a function in a process of this worker, and return (True, result) or (False, error), pickled.

    The payload is the pickled function with its arguments: the scheduler does not unpickle them. New
    processes are warmed up for `parameters`; a call may take `seconds`.
    """
    function, arguments = pickle.loads(payload)
    task = _pool(parameters, seconds).submit(function, *arguments)
    while not wait([task], POLL_SECONDS).done:
        if not _is_wanted():
            task.cancel()
    try:
        return pickle.dumps((True, task.result()))
    except Exception as error:
        return pickle.dumps((False, error))


def warm_up(parameters: Parameters, seconds: float) -> int:
    """Start the processes of this worker, wait until one is warm, and return the worker's process id."""
    pool = _pool(parameters, seconds)
    while not pool.pids():
        time.sleep(POLL_SECONDS)
    return os.getpid()


def _is_wanted() -> bool:
    """Return whether the task of this thread is still wanted; Dask itself stops no running task."""
    worker = get_worker()
    task = worker.state.tasks.get(worker.get_current_task())
    return task is not None and task.state != "cancelled"


def _pool(parameters: Parameters, seconds: float) -> LocalPool:
    """Return the pool of this worker, with a process for each of its threads; made at the first call."""
    with _making:
        if seconds not in _pools:
            # Imported here: a scheduler does not need the code of the tasks.
            from service.compute.tasks import warm  # noqa: PLC0415

            threads = get_worker().state.nthreads
            _pools[seconds] = LocalPool(threads, seconds=seconds, warm=partial(warm, parameters))
        return _pools[seconds]
