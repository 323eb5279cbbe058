"""What a worker of a Dask cluster does: it hands tasks to processes of its own.

So a task that takes too long, or ends its process, costs that task and not the worker; and the threads of the
worker, of which a task has one, only wait.
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
        The pickled function and its arguments: they pass through the scheduler as they are.
    parameters : Parameters
        What new processes are warmed up for.
    seconds : float
        The longest that the call may take.

    Returns
    -------
    bytes
        Pickled: whether it returned, and what it returned or raised.
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
    """Call a function in this process, where it keeps something from call to call; otherwise as `run`."""
    function, arguments = pickle.loads(payload)
    try:
        return pickle.dumps((True, function(*arguments)))
    except Exception as error:
        return pickle.dumps((False, error))


def warm_up(parameters: Parameters, seconds: float) -> int:
    """Start this worker's processes, and wait until one is warm; the worker's process id."""
    pool = _pool(parameters, seconds)
    while not pool.pids():
        time.sleep(LOOK_SECONDS)
    return os.getpid()


def _is_wanted() -> bool:
    """Whether somebody waits for what this thread does. Dask itself stops nothing that was begun."""
    worker = get_worker()
    task = worker.state.tasks.get(worker.get_current_task())
    return task is not None and task.state != "cancelled"


def _pool(parameters: Parameters, seconds: float) -> LocalPool:
    """As many processes as the worker has threads, made when they are first needed."""
    with _making:
        if seconds not in _pools:
            # The tasks' own code, which a scheduler has no need of.
            from service.compute.tasks import warm  # noqa: PLC0415

            threads = get_worker().state.nthreads
            _pools[seconds] = LocalPool(threads, seconds=seconds, warm=partial(warm, parameters))
        return _pools[seconds]
