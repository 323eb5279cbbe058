"""The fork server: a process with one thread that has run each task once, and forks each worker process."""

import multiprocessing
import os
import threading
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext, SpawnContext

from service.compute.worker_loop import THREADS

LOADED = ["service.compute.warm_start", "trimesh"]
"""The modules of the tasks; trimesh, which reads GLB, is otherwise imported with the first GLB."""

_starting = threading.Lock()


def fork_server() -> ForkServerContext | SpawnContext:
    """The context that starts worker processes; its fork server is running.

    The service itself is not forked: the fork of a process with threads may inherit a lock that is never
    released. A fresh process for each worker would load the tasks again, which takes a second. Systems
    without fork servers start fresh processes.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    with _starting:
        context.set_forkserver_preload(LOADED)
        kept = {name: os.environ.get(name) for name in THREADS}
        # Libraries read the number of threads when they load, in the fork server.
        os.environ.update(dict.fromkeys(THREADS, "1"))
        try:
            forkserver.ensure_running()
        finally:
            for name, value in kept.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
    return context
