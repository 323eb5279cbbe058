"""An executor on a Dask cluster, which may become unreachable and return.

Dask repeats the tasks of a lost worker on another worker. This module adds the rest: while the scheduler is
unreachable or has no workers, waiting tasks fail, and the executor tries to connect until it succeeds.
"""

import hashlib
import logging
import pickle
import secrets
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, InvalidStateError
from contextlib import suppress
from typing import Any

import dask
import numpy as np
from distributed import Client
from distributed.scheduler import KilledWorker
from numpy.typing import NDArray

from core.parameters import Parameters
from service.compute.dask_tasks import run, run_here, warm_up
from service.compute.workers_interface import RemoteWorkers
from service.errors import ClusterUnavailableError, TaskTimeLimitError, WorkerLostError
from service.observability.logging import get_logger

log = get_logger("compute")

# Dask logs tracebacks; this module logs the same events in one line each.
logging.getLogger("distributed.client").setLevel(logging.CRITICAL)

LOOK_SECONDS = 0.5
CONNECT_SECONDS = 5.0
# Waiting tasks fail when the cluster has had no workers for this time.
PATIENCE_SECONDS = 10.0

# Meshes pass through the scheduler, so that the loss of a worker loses no mesh.
dask.config.set({"distributed.admin.large-graph-warning-threshold": "4 GiB"})


class ClusterPool(RemoteWorkers):
    """The workers of a Dask cluster.

    Parameters
    ----------
    address : str
        The address of the scheduler.
    parameters : Parameters
        The parameters that workers are warmed up for.
    seconds : float
        The time limit of a task; after it, the future raises `TaskTimeLimitError`.
    replaced : callable
        Called whenever a task causes the replacement of a process, with the cause: "died" or "time-limit".
    """

    def __init__(
        self,
        address: str,
        *,
        parameters: Parameters,
        seconds: float,
        replaced: Callable[[str], object] = lambda cause: None,
    ) -> None:
        self.user = secrets.randbits(62)
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

        Raises
        ------
        ClusterUnavailableError
            The scheduler is unreachable, or has no workers.
        """
        if kwargs:
            raise TypeError("tasks take positional arguments only")
        executor = self._there()
        return self._follow(executor.submit(run, pickle.dumps((fn, args)), self._parameters, self._seconds))

    def owners(self, keys: NDArray[np.int64]) -> NDArray[np.str_]:
        """The worker that owns each key, shape (n,): the worker whose hash with the key is highest.

        Raises
        ------
        ClusterUnavailableError
            The scheduler is unreachable, or no worker is warm.
        """
        self._there()
        workers = sorted(self._pids)
        if not workers:
            raise ClusterUnavailableError("the cluster's workers are not ready yet")
        different, places = np.unique(keys, return_inverse=True)
        highest = [max(workers, key=lambda worker, key=key: _hash(worker, key)) for key in different.tolist()]  # type: ignore[misc]
        return np.array(highest, dtype=np.str_)[places]

    def submit_to(self, owner: str, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:  # noqa: ANN401
        """Call `fn(*args)` in the process of this worker, or of another worker if this one has left.

        Nothing stops a running call: it must be short and must not end the process.

        Raises
        ------
        ClusterUnavailableError
            The scheduler is unreachable, or has no workers.
        """
        self._there()
        client = self._client
        if client is None:
            raise ClusterUnavailableError("the cluster's scheduler cannot be reached now")
        executor = client.get_executor(pure=False, workers=[owner], allow_other_workers=True)
        return self._follow(executor.submit(run_here, pickle.dumps((fn, args))))

    def _there(self) -> Executor:
        """The executor of the cluster, if the scheduler is reachable and has workers."""
        if self._closing.is_set():
            raise RuntimeError("the pool is shut down")
        executor = self._executor
        if executor is None or not self._threads:
            away = "scheduler cannot be reached" if executor is None else "scheduler has no workers"
            raise ClusterUnavailableError(f"the cluster's {away} now")
        return executor

    def _follow(self, given: Future[Any]) -> Future[Any]:
        """The future that follows a future of the cluster."""
        task: Future[Any] = Future()
        with self._lock:
            self._open.add(task)
        task.add_done_callback(lambda task: self._ended(task, given))
        given.add_done_callback(lambda given: self._settle(task, given))
        return task

    def ready(self) -> bool:
        """Whether the cluster has a warm worker."""
        return bool(self._pids)

    def pids(self) -> list[int]:
        """The process ids of the warm workers, each on its machine."""
        return list(self._pids.values())

    def idle(self) -> int:
        """The number of tasks that could start at once."""
        return max(0, sum(self._threads.values()) - len(self._open))

    def busy(self) -> int:
        """The number of running tasks of this service, if no other service uses the cluster."""
        return min(sum(self._threads.values()), len(self._open))

    def starting(self) -> int:
        """The number of workers that are not warm yet."""
        return len(self._threads.keys() - self._pids.keys())

    def waiting(self) -> int:
        """The least number of tasks of this service that wait for a worker."""
        return max(0, len(self._open) - sum(self._threads.values()))

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
            self._watching.join()

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
        self._pids = {address: self._pids.get(address) or each.result() for address, each in warmed.items()}

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

    def _ended(self, task: Future[Any], given: Future[Any]) -> None:
        """Forget a task that has ended, and cancel it on the cluster if its caller cancelled it."""
        with self._lock:
            self._open.discard(task)
        given.cancel()

    def _settle(self, task: Future[Any], given: Future[Any]) -> None:
        """Set the result of a task, or an error of the service if the cluster has failed it."""
        if given.cancelled():
            _raise(task, ClusterUnavailableError("the cluster's scheduler was lost; try again"))
            return
        error = given.exception()
        if isinstance(error, KilledWorker):
            self._replaced("died")
            _raise(task, WorkerLostError("workers died before they had answered; try again"))
        elif error is not None:
            log.error("the cluster failed", exc_info=error)
            _raise(task, ClusterUnavailableError(f"the cluster failed: {type(error).__name__}"))
        else:
            done, answer = pickle.loads(given.result())
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


def _hash(worker: str, key: int) -> bytes:
    """The weight of a worker for a key in rendezvous hashing (Thaler and Ravishankar 1998)."""
    return hashlib.blake2b(f"{worker} {key}".encode(), digest_size=8).digest()
