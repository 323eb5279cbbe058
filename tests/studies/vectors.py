"""The time that PostgreSQL takes to find the nearest of many signatures, and the recall of its graph.

    python -m tests.studies.vectors DIR [--count 1000000] [--queries 50] [--ef-search 100 400 1000]

The signatures are made: groups of 200, as the poses of one body are, with a normal spread of a third of that
between groups. Queries are further members of such groups. The server is one of its own. Exits with status 1
unless exact search finds all of the nearest.
"""

import time
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from functools import partial
from itertools import product
from pathlib import Path

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
from service.storage.hnsw import EF_CONSTRUCTION, EF_SEARCH, M, ensure_hnsw, index_name
from tests.service import engines
from tests.studies.common import run, write

LENGTH = 33
GROUP = 200
SPREAD = 0.3
FINGERPRINT = "f" * 16
AT_ONCE = 20_000
TAGGED = 10
"""One shape in so many has the tag."""

MEMORY = "&options=-c%20maintenance_work_mem%3D2GB"


def signatures(count: int, queries: int, seed: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the signatures that are stored, shape (count, s), and those that are searched for."""
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
        columns += "created_at, updated_at, revision, collection_number, checksum"
        with cursor.copy(f"COPY shapes ({columns}) FROM STDIN") as rows:
            for n in numbers:
                shape = (n, f"{n:036x}", n, "off", f"{n}", f"{n}", "{}", '{"area": 1.0}', now, now, n)
                rows.write_row((*shape, DEFAULT_COLLECTION.number, ""))
        with cursor.copy("COPY shape_tags (shape_number, tag, position) FROM STDIN") as rows:
            for n in numbers[::TAGGED]:
                rows.write_row((n, "tenth", 0))
        columns = "number, blob_number, format, fingerprint, signature, record, checksum"
        with cursor.copy(f"COPY embeddings ({columns}) FROM STDIN") as rows:
            for n in numbers:
                rows.write_row((n, n, "off", FINGERPRINT, vector_text(stored[n - 1]), b"x", ""))


def truth(
    stored: NDArray[np.float32], query: NDArray[np.float32], count: int, step: int
) -> NDArray[np.int64]:
    """Return the numbers of the nearest among every `step`th signature, by plain computation."""
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
    """Return the milliseconds of each query, and the share of the nearest that it finds."""
    milliseconds, recall = [], []
    for query, expected in zip(asked, nearest, strict=False):
        began = time.perf_counter()
        shapes = search(query)
        milliseconds.append(1e3 * (time.perf_counter() - began))
        recall.append(len(np.intersect1d(shapes, expected)) / len(expected))
    return np.array(milliseconds), np.array(recall)


def main(
    folder: Path,
    count: int,
    queries: int,
    seed: int,
    m: int,
    ef_construction: int,
    ef_search: list[int],
    wanted: list[int],
    more: list[int],
) -> bool:
    """Write graph.csv and vectors.csv; return whether exact search has full recall."""
    stored, asked = signatures(count, queries, seed)
    url = engines.empty_database(migrated=True) + MEMORY
    fill(url, stored)
    rows, exact = [], True
    with closing(Database(url, lock_seconds=60)) as database:
        began = time.perf_counter()
        with database.write() as session:
            ensure_hnsw(session, FINGERPRINT, m=m, ef_construction=ef_construction)
        seconds = time.perf_counter() - began
        with engines.bare(url) as connection:
            connection.execute(text("ANALYZE"))
            size = text(f"SELECT pg_relation_size('{index_name(FINGERPRINT)}')")
            mib = connection.execute(size).scalar_one() / 2**20
        graph = {"signatures": count, "m": m, "ef_construction": ef_construction}
        write(folder / "graph.csv", [graph | {"built_s": seconds, "size_mib": mib}], digits=7)
        expected = {
            step: [truth(stored, query, max(wanted), step) for query in asked] for step in (1, TAGGED)
        }
        ways: list[tuple[int | None, int]] = [(None, 1), *product(ef_search, more)]
        for (ef, times), step, most in product(ways, (1, TAGGED), wanted):
            shapes = ShapeFilter(DEFAULT_COLLECTION.number, tags=() if step == 1 else ("tenth",))
            search = partial(_search, database, shapes=shapes, most=most, ef=ef, more=times)
            chosen = asked if ef is not None else asked[: max(1, queries // 5)]
            milliseconds, recall = measured(chosen, [each[:most] for each in expected[step]], search)
            p50, p95 = np.percentile(milliseconds, [50, 95])
            exact &= ef is not None or recall.min() == 1.0
            row = {"ef_search": ef or "exact", "more": times, "one_of": step, "wanted": most}
            row |= {"p50_ms": p50, "p95_ms": p95, "mean_recall": recall.mean(), "least_recall": recall.min()}
            rows.append(row)
    write(folder / "vectors.csv", rows)
    return bool(exact)


def _search(
    database: Database,
    query: NDArray[np.float32],
    *,
    shapes: ShapeFilter,
    most: int,
    ef: int | None,
    more: int,
) -> NDArray[np.int64]:
    with database.read() as session:
        return nearest(session, FINGERPRINT, query, most, shapes=shapes, ef_search=ef, more=more)


if __name__ == "__main__":
    try:
        run(
            main,
            __doc__,
            count=1_000_000,
            queries=50,
            seed=0,
            m=M,
            ef_construction=EF_CONSTRUCTION,
            ef_search=(100, EF_SEARCH, 1_000),
            wanted=(100, 1_000),
            more=(MORE,),
        )
    finally:
        engines.stop()
