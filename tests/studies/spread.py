"""Ingest on a cluster of one and of two workers, and what one and two processes embed with nothing between.

    python -m tests.studies.spread DIR [--files 112] [--collection COLLECTION] [--seconds 5]

A scheduler, workers, PostgreSQL and a service of its own run on this machine. Exits with status 1 if two
workers store fewer shapes in a second than one.
"""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx
import numpy as np

from core.gallery import CLASSES, make_shape
from core.io import Limits, format_of, read_mesh, write_mesh
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from service.client import Client
from service.compute.pool import LocalPool
from service.compute.tasks import embed_file, warm
from service.evaluation.benchmark_service import served
from service.evaluation.retrieval import collection_files
from tests.service import engines
from tests.service.dask_cluster import Cluster, cluster
from tests.service.support import wait_until
from tests.studies.common import run, write

SENDERS = 4
TURNS = 5


def files_to_send(count: int, first_pose: int, collection: Path | None) -> list[bytes]:
    """Return made shapes, or those of a collection, as files that no other call gives."""
    if collection is not None:
        # Another size each time: a file that was sent before would not be embedded again.
        size = 1.0 + first_pose / 1000
        chosen = [path for path, _ in collection_files(collection, count)]
        read = (read_mesh(path.read_bytes(), format_of(path.name)) for path in chosen)
        return [write_mesh(Mesh(size * mesh.vertices, mesh.faces), "ply") for mesh in read]
    labels = list(CLASSES)
    return [
        write_mesh(make_shape(labels[i % len(labels)], first_pose + i // len(labels)), "ply")
        for i in range(count)
    ]


def ingest(made: Cluster, client: Client, workers: int, sent: Sequence[bytes]) -> float:
    """Return the shapes that a cluster of so many workers stores in a second."""
    while len(made.workers) > workers:
        made.kill_worker()
    made.start(workers - len(made.workers))
    idle = f'isoshape_workers{{state="idle"}} {float(workers)}'
    wait_until(lambda: idle in httpx.get(f"{client.url}/metrics").text, seconds=600)
    began = time.perf_counter()
    with ThreadPoolExecutor(SENDERS) as senders:
        for _ in senders.map(lambda data: client.upload(("sent.ply", data)), sent):
            pass
    return len(sent) / (time.perf_counter() - began)


def embedded_in_a_second(sent: Sequence[bytes], seconds: float) -> float:
    """Return the files that this process embeds in a second."""
    began, count = time.perf_counter(), 0
    while time.perf_counter() < began + seconds:
        embed_file(sent[count % len(sent)], "ply", Limits(), DEFAULT)
        count += 1
    return count / (time.perf_counter() - began)


def ceiling(sent: Sequence[bytes], seconds: float) -> tuple[float, float]:
    """Return what one process and what two embed in a second: medians of turns."""
    with LocalPool(2, seconds=600, warm=partial(warm, DEFAULT)) as pool:
        rates = np.empty((TURNS, 2))
        for turn in rates:
            for count in (1, 2):
                tasks = [pool.submit(embedded_in_a_second, sent, seconds) for _ in range(count)]
                turn[count - 1] = sum(task.result() for task in tasks)
    alone, two = np.median(rates, axis=0).tolist()
    return alone, two


def main(folder: Path, files: int, collection: Path | None, seconds: float) -> bool:
    """Write spread.csv; return whether two workers store more than one."""
    with TemporaryDirectory() as scratch, cluster(Path(scratch)) as made:
        url = engines.empty_database(migrated=True)
        settings = {"scheduler": made.address, "workers": SENDERS, "rate_limit": 0}
        with served(url, **settings, duplicates_in_background=True) as (_, client):
            two, one, again = (
                ingest(made, client, workers, files_to_send(files, 10 + 10 * turn, collection))
                for turn, workers in enumerate((2, 1, 2))
            )
        alone, both = ceiling(files_to_send(len(CLASSES), 1, collection), seconds)
    two = 0.5 * (two + again)
    row = {"one_worker": one, "two_workers": two, "times": two / one}
    row |= {"one_process": alone, "two_processes": both, "times_processes": both / alone}
    write(folder / "spread.csv", [row])
    return two > one


if __name__ == "__main__":
    # Workers import `embedded_in_a_second` by the name of its module, which a script does not have.
    try:
        run(import_module("tests.studies.spread").main, __doc__, files=112, collection=Path, seconds=5.0)
    finally:
        engines.stop()
