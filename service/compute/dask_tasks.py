"""Functions that run on the workers of a Dask cluster: each worker hands tasks to processes of its own.

A task that takes too long, or ends its process, costs that task and not the worker. The threads of the
worker, one for each task, only wait.
"""

import os
import pickle
import threading
import time
from concurrent.futures import wait
from functools import partial

from distributed import get_worker

from core.parameters import Parameters
from service.compute.pool import LocalPool

LOOK_SECONDS = 0.25

_pools: dict[float, LocalPool] = {}
_making = threading.Lock()


def run(payload: bytes, parameters: Parameters, seconds: float) -> bytes:
    """Call a function in a process of this worker.

    Parameters
    ----------
    payload : bytes
        The pickled function and its arguments; the scheduler does not unpickle them.
    parameters : Parameters
        The parameters that new processes are warmed up for.
    seconds : float
        The time limit of the call.

    Returns
    -------
    bytes
        Pickled: (True, result) or (False, error).
    """
    function, arguments = pickle.loads(payload)
    task = _pool(parameters, seconds).submit(function, *arguments)
    while not wait([task], LOOK_SECONDS).done:
        if not _is_wanted():
            task.cancel()
    try:
        return pickle.dumps((True, task.result()))
    except Exception as error:
        return pickle.dumps((False, error))


def run_here(payload: bytes) -> bytes:
    """Call a function in the process of the worker itself, which keeps data between calls; else as `run`."""
    function, arguments = pickle.loads(payload)
    try:
        return pickle.dumps((True, function(*arguments)))
    except Exception as error:
        return pickle.dumps((False, error))


def warm_up(parameters: Parameters, seconds: float) -> int:
    """Start the processes of this worker, wait until one is warm, and return the worker's process id."""
    pool = _pool(parameters, seconds)
    while not pool.pids():
        time.sleep(LOOK_SECONDS)
    return os.getpid()


def _is_wanted() -> bool:
    """Whether the task of this thread is still wanted; Dask itself stops no running task."""
    worker = get_worker()
    task = worker.state.tasks.get(worker.get_current_task())
    return task is not None and task.state != "cancelled"


def _pool(parameters: Parameters, seconds: float) -> LocalPool:
    """The pool of this worker, with a process for each of its threads; made at the first call."""
    with _making:
        if seconds not in _pools:
            # Imported here: a scheduler does not need the code of the tasks.
            from service.compute.tasks import warm  # noqa: PLC0415

            threads = get_worker().state.nthreads
            _pools[seconds] = LocalPool(threads, seconds=seconds, warm=partial(warm, parameters))
        return _pools[seconds]
