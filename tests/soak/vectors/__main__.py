"""`python -m tests.soak.vectors --count 1000000`: a table of times and recall, on a server of its own.

The signatures are made: groups of 200, as the poses of one body are, with a normal spread of a third of that
between groups. Queries are further members of such groups.
"""

import argparse
import time
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from itertools import product

import numpy as np
import psycopg
from numpy.typing import NDArray
from sqlalchemy import text

from core.arrays import Floats
from service.collection import DEFAULT_COLLECTION
from service.search.repository import MORE, nearest
from service.shapes.records import ShapeFilter
from service.storage.columns import vector_text
from service.storage.database import Database
from service.storage.hnsw import ensure_hnsw, index_name
from service.storage.hnsw_parameters import HnswParameters
from tests.service import engines

LENGTH = 33
GROUP = 200
SPREAD = 0.3
FINGERPRINT = "f" * 16
AT_ONCE = 20_000
TAGGED = 10
"""Every so manieth shape has the tag."""

MEMORY = "&options=-c%20maintenance_work_mem%3D2GB"


def signatures(count: int, queries: int, seed: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Those that are stored, shape (count, s), and those that are searched for."""
    rng = np.random.default_rng(seed)
    middles = rng.normal(size=(max(1, count // GROUP), LENGTH)).astype(np.float32)
    stored, asked = (
        middles[rng.integers(len(middles), size=many)]
        + np.float32(SPREAD) * rng.normal(size=(many, LENGTH)).astype(np.float32)
        for many in (count, queries)
    )
    return stored, asked


def fill(url: str, stored: NDArray[np.float32]) -> None:
    """Store a shape for each signature, without a file or an embedding worth the name."""
    now = datetime.now(UTC).replace(tzinfo=None)
    numbers = range(1, len(stored) + 1)
    with psycopg.connect(url.replace("+psycopg", "")) as client, client.cursor() as cursor:
        with cursor.copy("COPY blobs (number, sha256, size, data) FROM STDIN") as rows:
            for n in numbers:
                rows.write_row((n, f"{n:064x}", 1, b"x"))
        columns = "number, id, blob_number, format, name, folded_name, meta, facts, "
        columns += "created_at, updated_at, revision, collection_number"
        with cursor.copy(f"COPY shapes ({columns}) FROM STDIN") as rows:
            for n in numbers:
                shape = (n, f"{n:036x}", n, "off", f"{n}", f"{n}", "{}", '{"area": 1.0}', now, now, n)
                rows.write_row((*shape, DEFAULT_COLLECTION.number))
        with cursor.copy("COPY shape_tags (shape_number, tag, place) FROM STDIN") as rows:
            for n in numbers[::TAGGED]:
                rows.write_row((n, "tenth", 0))
        columns = "number, blob_number, format, fingerprint, signature, record"
        with cursor.copy(f"COPY embeddings ({columns}) FROM STDIN") as rows:
            for n in numbers:
                rows.write_row((n, n, "off", FINGERPRINT, vector_text(stored[n - 1]), b"x"))


def truth(
    stored: NDArray[np.float32], query: NDArray[np.float32], count: int, step: int
) -> NDArray[np.int64]:
    """The numbers of the nearest, of every `step`th, by plain computation."""
    some = stored[::step]
    distances = np.concatenate(
        [((some[i : i + AT_ONCE] - query) ** 2).sum(axis=1) for i in range(0, len(some), AT_ONCE)]
    )
    return np.argsort(distances)[:count].astype(np.int64) * step + 1


def measured(
    asked: NDArray[np.float32],
    nearest: list[NDArray[np.int64]],
    search: Callable[[NDArray[np.float32]], NDArray[np.int64]],
) -> tuple[Floats, Floats]:
    """The milliseconds of each query, and the share of the nearest that it found."""
    milliseconds, recall = [], []
    for query, there in zip(asked, nearest, strict=False):
        began = time.perf_counter()
        found = search(query)
        milliseconds.append(1e3 * (time.perf_counter() - began))
        recall.append(len(np.intersect1d(found, there)) / len(there))
    return np.array(milliseconds), np.array(recall)


def main(
    count: int,
    queries: int,
    seed: int,
    graph: HnswParameters,
    wanted: list[int],
    more: list[int],
    efs: list[int],
    unfiltered: bool,
) -> None:
    stored, asked = signatures(count, queries, seed)
    url = engines.empty_database(migrated=True) + MEMORY
    fill(url, stored)
    with closing(Database(url, lock_seconds=60, hnsw=graph)) as database:
        began = time.perf_counter()
        with database.write() as session:
            ensure_hnsw(session, FINGERPRINT)
        build = time.perf_counter() - began
        with engines.bare(url) as connection:
            connection.execute(text("ANALYZE"))
            told = text(f"SELECT pg_relation_size('{index_name(FINGERPRINT)}')")
            size = connection.execute(told).scalar_one()
        how = f"m {graph.m}, ef_construction {graph.ef_construction}"
        print(f"{count:,} signatures of {LENGTH} numbers; {how}: in {build:.0f} s, {size / 2**20:.0f} MiB.\n")
        there = {step: [truth(stored, query, max(wanted), step) for query in asked] for step in (1, TAGGED)}
        print("| ef_search | taken | filter | wanted | p50 ms | p95 ms | recall, mean | recall, least |")
        print("|---|---|---|---:|---:|---:|---:|---:|")
        everything, tenth = (
            ShapeFilter(DEFAULT_COLLECTION.number),
            ShapeFilter(DEFAULT_COLLECTION.number, tags=("tenth",)),
        )
        meant = [(everything, 1, "")] + ([] if unfiltered else [(tenth, TAGGED, f"1 of {TAGGED}")])
        ways = [(None, 1), *((each, times) for each in efs for times in more)]
        for (ef, times), (shapes, step, about), most in product(ways, meant, wanted):

            def search(
                query: NDArray[np.float32],
                ef: int | None = ef,
                times: int = times,
                shapes: ShapeFilter = shapes,
                most: int = most,
            ) -> NDArray[np.int64]:
                with database.read() as session:
                    return nearest(
                        session, FINGERPRINT, query, most, shapes=shapes, ef_search=ef, more=times
                    ).shapes

            few = asked if ef is not None else asked[: max(1, queries // 5)]
            milliseconds, recall = measured(few, [each[:most] for each in there[step]], search)
            p50, p95 = np.percentile(milliseconds, [50, 95])
            how = "exact |" if ef is None else f"{ef} | {times} times"
            figures = f"{p50:.1f} | {p95:.1f} | {recall.mean():.4f} | {recall.min():.3f}"
            print(f"| {how} | {about} | {most:,} | {figures} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    usual = HnswParameters()
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--queries", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--m", type=int, default=usual.m)
    parser.add_argument("--ef-construction", type=int, default=usual.ef_construction)
    parser.add_argument("--ef-search", type=int, nargs="+", default=[100, usual.ef_search, 1_000])
    parser.add_argument("--wanted", type=int, nargs="+", default=[100, 1_000])
    parser.add_argument("--more", type=int, nargs="+", default=[MORE])
    parser.add_argument("--unfiltered", action="store_true")
    given = parser.parse_args()
    try:
        main(
            *(given.count, given.queries, given.seed, HnswParameters(given.m, given.ef_construction)),
            *(given.wanted, given.more, given.ef_search, given.unfiltered),
        )
    finally:
        engines.stop()
