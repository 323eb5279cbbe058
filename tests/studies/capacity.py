"""What a shape takes in bytes and seconds, and what exact search of many signatures takes.

    python -m tests.studies.capacity DIR [--count 10000000] [--queries 10]

The signatures are drawn as in `tests.studies.vectors`, written to a temporary file, 132 bytes each, and
searched through a memory map of it. Exits with status 1 unless the nearest are those of a plain computation.
"""

import resource
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s
from core.gallery import make_shape
from core.io import write_mesh
from core.matching.match_records import match_record
from core.parameters import DEFAULT
from core.ranking.reranking import coarse_samples, quantised_points
from core.ranking.shortlist import least, signature_distances
from core.serialization import embedding_to_bytes
from service.collection import DEFAULT_COLLECTION
from service.compute.tasks import embed_mesh
from service.evaluation.archive_repository import fill, originals
from service.evaluation.benchmark_meshes import Source
from service.pipelines.active import Pipelines, begin
from service.shapes import file_repository, repository
from service.shapes.records import NewShape
from service.storage.database import Database
from service.storage.migrate import migrate
from tests.service import engines
from tests.studies.common import run, write
from tests.studies.vectors import GROUP, LENGTH, SPREAD

SHAPES = 2_000
STORED = 500
AT_ONCE = 500_000
WANTED = 1_000


def bytes_of_a_shape() -> list[dict[str, object]]:
    """Return the bytes of each kind that a shape takes, its own file apart."""
    source = Source({label: [(label, make_shape(label, 0))] for label in ("cup", "octopus")})
    shapes = originals(source)
    with TemporaryDirectory() as folder:
        fill(f"sqlite:///{folder}/archive.sqlite3", shapes, SHAPES)
        archive = sum(path.stat().st_size for path in Path(folder).iterdir()) / SHAPES
    embedding = shapes[0].embedding
    sizes = {
        "archive, with a file of 8 bytes": archive,
        "record": np.mean([len(embedding_to_bytes(shape.embedding)) for shape in shapes]),
        "signature": embedding.signature.nbytes,
        "coarse samples": len(coarse_samples(embedding)),
        "quantised points": len(quantised_points(embedding)),
        "match record": np.mean([match_record(shape.embedding, DEFAULT).nbytes for shape in shapes]),
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


def made(path: Path, count: int) -> Float32s:
    """Write signatures to a file, and return its memory map."""
    rng = np.random.default_rng(0)
    middles = rng.normal(size=(max(1, count // GROUP), LENGTH)).astype(np.float32)
    stored = np.memmap(path, dtype=np.float32, mode="w+", shape=(count, LENGTH))
    for start in range(0, count, AT_ONCE):
        groups = rng.integers(len(middles), size=min(AT_ONCE, count - start))
        noise = rng.standard_normal((len(groups), LENGTH), dtype=np.float32)
        stored[start : start + len(groups)] = middles[groups] + np.float32(SPREAD) * noise
    stored.flush()
    return np.memmap(path, dtype=np.float32, mode="c", shape=(count, LENGTH))


def nearest(stored: Float32s, query: Float32s, threads: ThreadPoolExecutor, parts: int) -> NDArray[np.intp]:
    """Return the indices of the nearest signatures, searched in so many parts at a time."""
    ends = np.linspace(0, len(stored), parts + 1).astype(int)
    distances = threads.map(lambda ends: signature_distances(query, stored[slice(*ends)]), pairwise(ends))
    return least(np.concatenate(list(distances)), np.arange(len(stored)), WANTED)


def truth(stored: Float32s, query: Float32s) -> NDArray[np.intp]:
    """Return the same indices by plain computation."""
    squares = [
        ((stored[start : start + AT_ONCE].astype(np.float64) - query) ** 2).sum(axis=1)
        for start in range(0, len(stored), AT_ONCE)
    ]
    return np.argsort(np.concatenate(squares), kind="stable")[:WANTED]


def main(folder: Path, count: int, queries: int) -> bool:
    """Write bytes.csv, storing.csv and search.csv; return whether the nearest are right."""
    write(folder / "bytes.csv", bytes_of_a_shape())
    write(folder / "storing.csv", stored_in_a_second())
    rows: list[dict[str, object]] = []
    with TemporaryDirectory() as scratch, ThreadPoolExecutor(2) as threads:
        stored = made(Path(scratch) / "signatures", count)
        asked = np.array(stored[:: count // queries][:queries]) + np.float32(0.1)
        for parts in (1, 2):
            seconds = []
            for query in asked:
                began = time.perf_counter()
                indices = nearest(stored, query, threads, parts)
                seconds.append(time.perf_counter() - began)
            row: dict[str, object] = {"signatures": count, "threads": parts, "first_s": seconds[0]}
            rows.append(row | {"median_s": float(np.median(seconds[1:])), "most_s": max(seconds[1:])})
        right = np.array_equal(indices, truth(stored, asked[-1]))
    write(folder / "search.csv", rows)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:,.0f} MiB; right: {right}")
    return right


if __name__ == "__main__":
    try:
        run(main, __doc__, count=10_000_000, queries=10)
    finally:
        engines.stop()
