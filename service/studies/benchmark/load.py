"""Many clients at once: the capacity of the service, and the time of queries at half of it."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from time import perf_counter, sleep

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.client import Client, ClientError
from service.studies.benchmark.archive import STEP, Original, fill, shape_id
from service.studies.benchmark.meshes import Source
from service.studies.benchmark.searching import served

SHAPES, QUERYING, INGESTING = 380, 8, 2
CAPACITY_SECONDS, ALONE, SECONDS = 20.0, 60, 60.0
SHARE = 0.5
"""Load as a share of the capacity."""


@dataclass(frozen=True)
class LoadRow:
    """One archive under load; times in seconds.

    Attributes
    ----------
    shapes, querying, ingesting : int
        Number of shapes at the start, and numbers of clients that query and upload.
    queries_a_second, uploads_a_second : float
        Capacity: answers per second while every client sends the next request at once.
    alone_median, alone_p95 : float
        Time of a query of a single client.
    seconds : float
        Duration of the load of `SHARE` times the capacity, at even intervals.
    queries, uploads, errors : int
        Successful and failed requests during that time.
    median, p95 : float
        Time of a query, from its due time.
    """

    shapes: int
    querying: int
    ingesting: int
    queries_a_second: float
    uploads_a_second: float
    alone_median: float
    alone_p95: float
    seconds: float
    queries: int
    uploads: int
    errors: int
    median: float
    p95: float


class _Clients:
    """Clients in separate threads; each repeats one kind of request."""

    def __init__(self, url: str, asks: Sequence[Callable[[Client], object]]) -> None:
        self._url = url
        self._asks = asks

    def run(self, seconds: float, intervals: Sequence[float]) -> list[list[tuple[float, bool]]]:
        """The time of each client's requests, counted from their due time, and whether they failed.

        Parameters
        ----------
        seconds : float
        intervals : sequence of float
            Interval between requests of each client; with 0, a request is due after the previous answer.
        """
        found: list[list[tuple[float, bool]]] = [[] for _ in self._asks]
        start = perf_counter()

        def ask(which: int) -> None:
            interval = intervals[which]
            with Client(self._url) as client:
                for number in count():
                    due = start + (number + which / len(intervals)) * interval if interval else perf_counter()
                    began = perf_counter()
                    if max(due, began) >= start + seconds:
                        return
                    if due > began:
                        sleep(due - began)
                    try:
                        self._asks[which](client)
                        failed = False
                    except ClientError:
                        failed = True
                    found[which].append((perf_counter() - due, failed))

        threads = [threading.Thread(target=ask, args=(which,)) for which in range(len(self._asks))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return found


def load_row(
    source: Source,
    originals: Sequence[Original],
    scratch: Path,
    *,
    shapes: int = SHAPES,
    capacity_seconds: float = CAPACITY_SECONDS,
    alone: int = ALONE,
    seconds: float = SECONDS,
) -> LoadRow:
    """Measure one client alone, then the capacity with all clients, then the times at half of it."""
    url = f"sqlite:///{scratch / 'load.sqlite3'}"
    fill(url, originals, shapes, lambda written: None)
    numbers, files = count(), _files(source)
    turn = threading.Lock()

    def query(client: Client) -> object:
        return client.query_shape(shape_id(next(numbers) * STEP % shapes))

    def upload(client: Client) -> object:
        with turn:
            name, data = next(files)
        return client.upload((name, data))

    with ExitStack() as stack:
        service, client = stack.enter_context(served(url))
        query(client)
        times = []
        for _ in range(alone):
            before = perf_counter()
            query(client)
            times.append(perf_counter() - before)
        clients = _Clients(service.url, [query] * QUERYING + [upload] * INGESTING)
        most = clients.run(capacity_seconds, [0.0] * (QUERYING + INGESTING))
        # Without any answer, the capacity counts as one request.
        done = [max(sum(map(len, some)), 1) for some in (most[:QUERYING], most[QUERYING:])]
        rates = [number / capacity_seconds for number in done]
        intervals = [QUERYING / (SHARE * rates[0])] * QUERYING + [INGESTING / (SHARE * rates[1])] * INGESTING
        found = clients.run(seconds, intervals)
    queries = [one for client_times in found[:QUERYING] for one in client_times]
    uploads = [one for client_times in found[QUERYING:] for one in client_times]
    return LoadRow(
        shapes=shapes,
        querying=QUERYING,
        ingesting=INGESTING,
        queries_a_second=rates[0],
        uploads_a_second=rates[1],
        alone_median=float(np.median(times)),
        alone_p95=float(np.percentile(times, 95)),
        seconds=seconds,
        queries=len(queries),
        uploads=len(uploads),
        errors=sum(failed for _, failed in (*queries, *uploads)),
        median=float(np.median([spent for spent, _ in queries])),
        p95=float(np.percentile([spent for spent, _ in queries], 95)),
    )


def _files(source: Source) -> Iterator[tuple[str, bytes]]:
    """The meshes of the source in an endless cycle, each time with another size and name."""
    meshes = [entry for some in source.classes.values() for entry in some]
    for number in count():
        name, mesh = meshes[number * STEP % len(meshes)]
        larger = Mesh(mesh.vertices * (1.0 + 1e-6 * (number + 1)), mesh.faces)
        yield f"{number} {name}.off", write_mesh(larger, "off")
