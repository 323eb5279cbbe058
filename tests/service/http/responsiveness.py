"""How fast a service answers others while something else keeps it busy."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import httpx
import numpy as np

LEAST_REQUESTS, MOST_REQUESTS = 100, 1000
LEAST_INTERVAL_SECONDS = 0.01
SHARE = 3
"""Requests are due at intervals of this many times as long as one takes. At shorter ones a slow machine would
fall behind with every request, whatever else the service does."""
LEAST_BOUND_SECONDS = 0.25
TRIES = 3


def interval_seconds(client: httpx.Client, path: str) -> float:
    """The time between two requests: 10 ms, or `SHARE` times the median of 20 requests if that is longer."""
    seconds = []
    for _ in range(20):
        start = time.perf_counter()
        assert client.get(path).status_code == 200
        seconds.append(time.perf_counter() - start)
    return max(LEAST_INTERVAL_SECONDS, SHARE * float(np.median(seconds)))


def p95_seconds(
    client: httpx.Client, path: str, interval: float, ended: Callable[[], bool] = lambda: True
) -> float:
    """The 95th percentile of the times of requests: 100 at least, and until `ended`, 1,000 at most.

    A request is due every `interval` seconds, and its time begins when it is due: a service that stands still
    for a second delays all requests that are due in that second.
    """
    seconds: list[float] = []
    due = time.perf_counter()
    while len(seconds) < LEAST_REQUESTS or (len(seconds) < MOST_REQUESTS and not ended()):
        time.sleep(max(0.0, due - time.perf_counter()))
        assert client.get(path).status_code == 200
        seconds.append(time.perf_counter() - due)
        due += interval
    return float(np.percentile(seconds, 95))


def assert_others_are_served(
    client: httpx.Client, load: Callable[[], object], *, at_a_time: int = 1, path: str = "/shapes"
) -> None:
    """Send requests one after another while `load` runs in threads.

    Their p95 may be the larger of twice the baseline and 250 ms. Other work of the machine may disturb a
    measurement, so one of three must hold.
    """
    measured = []
    for _ in range(TRIES):
        p95 = partial(p95_seconds, client, path, interval_seconds(client, path))
        with ThreadPoolExecutor(at_a_time) as threads:
            loads = [threads.submit(load) for _ in range(at_a_time)]
            meanwhile = p95(lambda loads=loads: all(each.done() for each in loads))
            for each in loads:
                each.result()
        # The baseline costs as much again, and is seldom needed.
        if meanwhile <= LEAST_BOUND_SECONDS or meanwhile <= 2 * (baseline := p95()):
            return
        measured.append((meanwhile, baseline))
    raise AssertionError(f"p95 beside the load, and without it: {measured}")
