"""What a shape takes in bytes and seconds, and what search of many signatures takes, in memory and in
PostgreSQL.

    python -m tests.studies.capacity DIR [--count 10000000] [--rows 1000000] [--ef-search 100 400 1000]

The signatures are made: groups of 200, as the poses of one body are, with a normal spread of a third of that
between groups; queries are further members of such groups. In memory they are searched through a memory map
of a temporary file, 132 bytes each. PostgreSQL is a server of its own. Exits with status 1 unless exact
search finds the nearest by plain computation, both ways.
"""

import resource
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import psycopg
from numpy.typing import NDArray
from sqlalchemy import text

from core.arrays import Float32s
from core.gallery import make_shape
from core.io import write_mesh
from core.matching.match_records import match_record
from core.matching.quantised_points import quantised_points
from core.parameters import DEFAULT
from core.ranking.reranking import coarse_samples
from core.ranking.shortlist import least, signature_distances
from core.serialization import embedding_to_bytes
from service.collection import DEFAULT_COLLECTION
from service.compute.tasks import embed_mesh
from service.evaluation.benchmark_service import fill, originals
from service.pipelines.active import Pipelines, begin
from service.search.repository import MORE, nearest
from service.shapes import file_repository, repository
from service.shapes.records import NewShape, ShapeFilter
from service.storage.columns import vector_text
from service.storage.database import Database, migrate
from service.storage.postgresql import EF_CONSTRUCTION, EF_SEARCH, M, ensure_hnsw, index_name
from tests.service import engines
from tests.studies.common import run, write

SHAPES, STORED = 2_000, 500
"""Shapes of an archive whose bytes are counted, and shapes stored one after another."""

LENGTH, GROUP, SPREAD = 33, 200, 0.3
AT_ONCE = 500_000
WANTED = (100, 1_000)
TAGGED = 10
"""One shape in so many has the tag."""

FINGERPRINT = "f" * 16
MEMORY = "&options=-c%20maintenance_work_mem%3D2GB"


def bytes_of_a_shape() -> list[dict[str, object]]:
    """Return the bytes of each kind that a shape takes, its own file apart."""
    shapes = originals({label: [(label, make_shape(label, 0))] for label in ("cup", "octopus")})
    with TemporaryDirectory() as folder:
        fill(f"sqlite:///{folder}/archive.sqlite3", shapes, SHAPES)
        archive = sum(path.stat().st_size for path in Path(folder).iterdir()) / SHAPES
    embeddings = [embedding for _, embedding in shapes]
    sizes = {
        "archive, with a file of 8 bytes": archive,
        "record": np.mean([len(embedding_to_bytes(embedding)) for embedding in embeddings]),
        "signature": embeddings[0].signature.nbytes,
        "coarse samples": len(coarse_samples(embeddings[0])),
        "quantised points": len(quantised_points(embeddings[0])),
        "match record": np.mean([match_record(embedding, DEFAULT).nbytes for embedding in embeddings]),
    }
    return [{"of_a_shape": name, "bytes": round(float(size))} for name, size in sizes.items()]


def stored_in_a_second() -> list[dict[str, object]]:
    """Store shapes one after another, each in a transaction of its own, in SQLite and in PostgreSQL."""
    mesh = make_shape("octopus", 0)
    embedded = embed_mesh(mesh, DEFAULT, 0.0)
    data = write_mesh(mesh, "ply")
    rows: list[dict[str, object]] = []
    with TemporaryDirectory() as folder:
        for url in (f"sqlite:///{folder}/archive.sqlite3", engines.empty_database()):
            with closing(Database(url, lock_seconds=10)) as database:
                migrate(database)
                begin(Pipelines(DEFAULT), database)
                began = time.perf_counter()
                for number in range(STORED):
                    file = data + number.to_bytes(8, "big")
                    new = NewShape(file, "ply", DEFAULT_COLLECTION.number, str(number), (), {})
                    with database.write() as session:
                        blob = file_repository.add_blob(session, new.data, new.sha256)
                        file_repository.add_embedding(session, blob, "ply", DEFAULT.fingerprint, embedded)
                        repository.add_shape(session, blob, new, embedded.facts)
                seconds = time.perf_counter() - began
            rows.append({"database": url.partition(":")[0], "shapes_a_second": STORED / seconds})
    return rows


def signatures(path: Path, count: int, queries: int) -> tuple[Float32s, Float32s]:
    """Return a memory map of signatures written to a file, shape (count, s), and those to search for."""
    rng = np.random.default_rng(0)
    middles = rng.normal(size=(max(1, count // GROUP), LENGTH)).astype(np.float32)

    def members(many: int) -> Float32s:
        noise = rng.standard_normal((many, LENGTH), dtype=np.float32)
        return np.asarray(middles[rng.integers(len(middles), size=many)] + np.float32(SPREAD) * noise)

    stored = np.memmap(path, dtype=np.float32, mode="w+", shape=(count, LENGTH))
    for start in range(0, count, AT_ONCE):
        stored[start : start + AT_ONCE] = members(min(AT_ONCE, count - start))
    stored.flush()
    return np.memmap(path, dtype=np.float32, mode="c", shape=(count, LENGTH)), members(queries)


def truth(stored: Float32s, query: Float32s, count: int, step: int = 1) -> NDArray[np.int64]:
    """Return the indices of the nearest among every `step`th signature, by plain computation."""
    chosen = stored[::step]
    squares = [
        ((chosen[start : start + AT_ONCE].astype(np.float64) - query) ** 2).sum(axis=1)
        for start in range(0, len(chosen), AT_ONCE)
    ]
    return step * np.argsort(np.concatenate(squares), kind="stable")[:count].astype(np.int64)


Search = Callable[[Float32s], NDArray[np.int64]]


def measured(search: Search, asked: Float32s, expected: list[NDArray[np.int64]]) -> dict[str, float]:
    """Return the times of queries, the first apart, and the shares of the nearest that they find."""
    times, recall = [], []
    for query, right in zip(asked, expected, strict=False):
        began = time.perf_counter()
        indices = search(query)
        times.append(1e3 * (time.perf_counter() - began))
        recall.append(len(np.intersect1d(indices, right)) / len(right))
    p50, p95 = np.percentile(times[1:] or times, [50, 95])
    figures = {"first_ms": times[0], "p50_ms": p50, "p95_ms": p95, "most_ms": max(times)}
    return figures | {"mean_recall": float(np.mean(recall)), "least_recall": min(recall)}


def in_memory(path: Path, count: int, queries: int) -> list[dict[str, object]]:
    """Search signatures through a memory map, by one thread and by two."""
    rows: list[dict[str, object]] = []
    stored, asked = signatures(path, count, queries)
    wanted = WANTED[-1]
    expected = [truth(stored, query, wanted) for query in asked]
    with ThreadPoolExecutor(2) as threads:
        for parts in (1, 2):
            ends = np.linspace(0, count, parts + 1).astype(int)

            def search(query: Float32s, ends: NDArray[np.intp] = ends) -> NDArray[np.int64]:
                pieces = threads.map(
                    lambda each: signature_distances(query, stored[slice(*each)]), pairwise(ends)
                )
                return least(np.concatenate(list(pieces)), np.arange(count), wanted).astype(np.int64)

            rows.append({"signatures": count, "threads": parts} | measured(search, asked, expected))
    return rows


def fill_postgresql(url: str, stored: Float32s) -> None:
    """Store a shape for each signature, without a file or an embedding worth the name."""
    now = datetime.now(UTC).replace(tzinfo=None)
    shape = "number, id, blob_number, format, name, folded_name, meta, facts, "
    shape += "created_at, updated_at, revision, collection_number, checksum"
    embedding = "number, blob_number, format, fingerprint, signature, record, checksum"
    tables: dict[str, Callable[[int], tuple[object, ...]]] = {
        "blobs (number, sha256, size, data)": lambda n: (n, f"{n:064x}", 1, b"x"),
        f"shapes ({shape})": lambda n: (
            *(n, f"{n:036x}", n, "off", f"{n}", f"{n}", "{}", '{"area": 1.0}'),
            *(now, now, n, DEFAULT_COLLECTION.number, ""),
        ),
        "shape_tags (shape_number, tag, position)": lambda n: (n, "tenth", 0),
        f"embeddings ({embedding})": lambda n: (
            *(n, n, "off", FINGERPRINT),
            *(vector_text(stored[n - 1]), b"x", ""),
        ),
    }
    with psycopg.connect(url.replace("+psycopg", "")) as client, client.cursor() as cursor:
        for table, row in tables.items():
            step = TAGGED if table.startswith("shape_tags") else 1
            with cursor.copy(f"COPY {table} FROM STDIN") as rows:
                for number in range(1, len(stored) + 1, step):
                    rows.write_row(row(number))


def in_postgresql(
    path: Path, count: int, queries: int, ef_search: list[int], more: list[int]
) -> tuple[dict[str, object], list[dict[str, object]]]:
    """Return the size of the graph and the seconds to build it, and searches, exact and by the graph."""
    stored, asked = signatures(path, count, queries)
    url = engines.empty_database(migrated=True) + MEMORY
    fill_postgresql(url, stored)
    rows: list[dict[str, object]] = []
    with closing(Database(url, lock_seconds=60)) as database:
        began = time.perf_counter()
        with database.write() as session:
            ensure_hnsw(session, FINGERPRINT)
        graph: dict[str, object] = {"signatures": count, "m": M, "ef_construction": EF_CONSTRUCTION}
        graph["built_s"] = time.perf_counter() - began
        with engines.bare(url) as connection:
            connection.execute(text("ANALYZE"))
            size = text(f"SELECT pg_relation_size('{index_name(FINGERPRINT)}')")
            graph["size_mib"] = connection.execute(size).scalar_one() / 2**20
        expected = {step: [truth(stored, query, WANTED[-1], step) for query in asked] for step in (1, TAGGED)}
        ways: list[tuple[int | None, int]] = [(None, 1), *product(ef_search, more)]
        for (ef, times), step, most in product(ways, (1, TAGGED), WANTED):
            shapes = ShapeFilter(DEFAULT_COLLECTION.number, tags=() if step == 1 else ("tenth",))
            search = partial(_search, database, shapes=shapes, most=most, ef=ef, more=times)
            chosen = asked if ef is not None else asked[: max(1, queries // 5)]
            row: dict[str, object] = {
                "ef_search": ef or "exact",
                "more": times,
                "one_of": step,
                "wanted": most,
            }
            rows.append(row | measured(search, chosen, [each[:most] for each in expected[step]]))
    return graph, rows


def _search(
    database: Database, query: Float32s, *, shapes: ShapeFilter, most: int, ef: int | None, more: int
) -> NDArray[np.int64]:
    with database.read() as session:
        numbers = nearest(session, FINGERPRINT, query, most, shapes=shapes, ef_search=ef, more=more)
    # Shapes are numbered from 1.
    return numbers - 1


def main(folder: Path, count: int, rows: int, queries: int, ef_search: list[int], more: list[int]) -> bool:
    """Write bytes.csv, storing.csv, search.csv, graph.csv and vectors.csv; return whether exact search is
    right."""
    write(folder / "bytes.csv", bytes_of_a_shape())
    write(folder / "storing.csv", stored_in_a_second())
    with TemporaryDirectory() as scratch:
        searches = in_memory(Path(scratch) / "memory", count, max(2, queries // 5))
        write(folder / "search.csv", searches)
        print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:,.0f} MiB")
        graph, vectors = in_postgresql(Path(scratch) / "rows", rows, queries, ef_search, more)
    write(folder / "graph.csv", [graph], digits=7)
    write(folder / "vectors.csv", vectors)
    exact = [*searches, *(row for row in vectors if row["ef_search"] == "exact")]
    return all(row["least_recall"] == 1.0 for row in exact)


if __name__ == "__main__":
    try:
        options = {"count": 10_000_000, "rows": 1_000_000, "queries": 50}
        run(main, __doc__, **options, ef_search=(100, EF_SEARCH, 1_000), more=(MORE,))
    finally:
        engines.stop()
