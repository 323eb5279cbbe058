"""`python -m tests.soak.spread --shapes 20000`: ingest and exhaustive queries with one and with two workers.

On a Dask scheduler and workers of one thread, a PostgreSQL server and a service, all of them on this machine
and started for it. Two workers, then one, then two again, so that what else the machine does meets both.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import httpx
import numpy as np

from core.gallery import CLASSES, make_shape
from core.io import format_of, read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.client import Client
from service.datasets import read_collection
from service.evaluation.archive_repository import STEP, fill, originals, shape_id
from service.evaluation.benchmark_meshes import read_source
from service.evaluation.retrieval import spread
from service.server.process import LOOPBACK, ChildService, bind, wait_until_ready
from tests.service import engines
from tests.service.dask_cluster import Cluster, cluster
from tests.service.support import wait_until
from tests.soak.spread.ceiling import ceilings
from tests.soak.spread.shares import Shares, shares

SENDERS = 4
ROOM = 4 * 1024**3
TABLES = ("blobs", "shapes", "embeddings")


def archive(shapes: int) -> str:
    """A database of so many shapes, which further ones can be stored in."""
    url = engines.empty_database(migrated=True)
    fill(url, originals(read_source(None)), shapes)
    with engines.bare(url) as connection:
        for table in TABLES:
            last = f"SELECT setval(pg_get_serial_sequence('{table}', 'number'), max(number)) FROM {table}"
            connection.exec_driver_sql(last)
        connection.exec_driver_sql("ANALYZE")
    return url


@contextmanager
def serving(url: str, scheduler: str) -> Iterator[Client]:
    with bind(LOOPBACK, 0) as bound:
        port = bound.getsockname()[1]
    given = {
        "ISOSHAPE_DATABASE_URL": url,
        "ISOSHAPE_SCHEDULER": scheduler,
        "ISOSHAPE_WORKERS": str(SENDERS),
        "ISOSHAPE_SEARCH_BYTES": str(ROOM),
        "ISOSHAPE_RATE_LIMIT": "0",
        "ISOSHAPE_LOG_LEVEL": "error",
    }
    with ChildService(port, given) as service, Client(service.url) as client:
        wait_until_ready(client, service.ended)
        yield client


def files(count: int, first_pose: int, collection: Path | None) -> list[bytes]:
    """Made shapes, or those of a collection spread over its classes, as files that no other call gives."""
    if collection is not None:
        # Of another size each time: a file that was sent before would not be embedded again.
        size = 1.0 + first_pose / 1000
        chosen = [path for path, _ in spread(read_collection(collection), count)]
        read = (read_mesh(path.read_bytes(), format_of(path.name)) for path in chosen)
        return [write_mesh(Mesh(size * mesh.vertices, mesh.faces), "ply") for mesh in read]
    labels = list(CLASSES)
    return [
        write_mesh(make_shape(labels[i % len(labels)], first_pose + i // len(labels)), "ply")
        for i in range(count)
    ]


def ingest(client: Client, sent: list[bytes]) -> tuple[float, Shares]:
    """Shapes stored in a second, and who was busy."""
    with ThreadPoolExecutor(SENDERS) as senders, shares() as used:
        for _ in senders.map(lambda data: client.upload(("sent.ply", data)), sent):
            pass
    return len(sent) / used.seconds, used


def search(client: Client, shapes: int, queries: int) -> tuple[float, Shares, int]:
    """Shapes matched in a second, median of queries after one that fills the workers; and who was busy."""
    client.query_shape(shape_id(0), exhaustive=True)
    rates = []
    with shares() as used:
        for number in range(queries):
            began = time.perf_counter()
            answer = client.query_shape(shape_id(number * STEP % shapes), exhaustive=True)
            rates.append(answer.compared / (time.perf_counter() - began))
    return float(np.median(rates)), used, answer.compared


def turn(
    made: Cluster, client: Client, workers: int, asked: argparse.Namespace, pose: int
) -> tuple[float, float]:
    """Both, with so many workers; each told as a line of the table."""
    while len(made.workers) > workers:
        made.kill_worker()
    made.start(workers - len(made.workers))
    idle = f'isoshape_workers{{state="idle"}} {float(workers)}'
    wait_until(lambda: idle in httpx.get(f"{client.url}/metrics").text, seconds=600)
    matched, used, compared = search(client, asked.shapes, asked.queries)
    print(f"| query of {compared:,} | {workers} | {matched:,.0f} matches/s | {used} |", flush=True)
    stored, used = ingest(client, files(asked.files, pose, asked.collection))
    print(f"| ingest | {workers} | {stored:.1f} shapes/s | {used} |", flush=True)
    return matched, stored


def main(asked: argparse.Namespace) -> None:
    with tempfile.TemporaryDirectory() as folder, cluster(Path(folder)) as made:
        url = archive(asked.shapes)
        print("| what | workers | in a second | processors busy |")
        print("|---|---:|---:|---|", flush=True)
        with serving(url, made.address) as client:
            found = np.array(
                [turn(made, client, workers, asked, 10 + 10 * i) for i, workers in enumerate((2, 1, 2))]
            )
        two, one = found[[0, 2]].mean(axis=0), found[1]
        most = ceilings(files(len(CLASSES), 1, asked.collection), asked.seconds)
        print("\n| what | one worker | two | times | one process alone | two | times |")
        print("|---|---:|---:|---:|---:|---:|---:|")
        for name, a, b in zip(("query", "ingest"), one, two, strict=True):
            c, d = most[name]
            print(f"| {name} | {a:,.1f} | {b:,.1f} | {b / a:.2f} | {c:,.1f} | {d:,.1f} | {d / c:.2f} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=20_000)
    parser.add_argument("--queries", type=int, default=10)
    parser.add_argument("--files", type=int, default=112)
    parser.add_argument("--collection", type=Path, help="ingest these meshes instead of made ones")
    parser.add_argument("--seconds", type=float, default=5.0)
    try:
        main(parser.parse_args())
    finally:
        engines.stop()
