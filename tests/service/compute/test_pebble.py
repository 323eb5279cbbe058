"""Why the pool of worker processes is our own: what happens to `pebble.ProcessPool` when idle workers die.

`test_pool.py` has the same case for `LocalPool`, as `test_workers_that_die_idle_cost_nothing`.
"""

import multiprocessing
import os
import signal

import pebble
import pytest

from tests.service.support import wait_until
from tests.service.tasks import add


def test_a_worker_that_dies_idle_breaks_the_pool_of_pebble_for_good() -> None:
    pool = pebble.ProcessPool(max_workers=2, context=multiprocessing.get_context("spawn"))
    try:
        idle = pool.schedule(os.getpid).result(timeout=60)
        os.kill(idle, signal.SIGKILL)
        wait_until(lambda: not pool.active, seconds=30)
        with pytest.raises(RuntimeError, match="error within the Pool"):
            pool.schedule(add, args=(1, 1))
    finally:
        pool.stop()
        pool.join()
