"""`python -m tests.soak.capacity --count 10000000`: bytes a shape, and exact search of COUNT signatures.

The signatures are drawn as in `tests.soak.vectors`. They are written to a temporary file, 132 bytes each, and
searched through a memory map of this file, which is removed at the end.
"""

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats
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
from service.storage.hnsw_parameters import HnswParameters
from service.storage.migrate import migrate
from tests.service import engines
from tests.soak.vectors.__main__ import GROUP, LENGTH, SPREAD

SHAPES = 2_000
STORED = 500
AT_ONCE = 500_000
WANTED = 1_000
MIB = 2**20


def of_a_shape(folder: Path) -> None:
    """Bytes of a shape, its own file apart."""
    source = Source({label: [(label, make_shape(label, 0))] for label in ("cup", "octopus")})
    found = originals(source)
    fill(f"sqlite:///{folder}/archive.sqlite3", found, SHAPES)
    stored = sum(path.stat().st_size for path in folder.iterdir()) / SHAPES
    print("| of a shape | bytes |\n|---|---:|")
    for name, size in (
        ("archive, its file of 8 bytes included", stored),
        ("record", np.mean([len(embedding_to_bytes(one.embedding)) for one in found])),
        ("signature", found[0].embedding.signature.nbytes),
        ("sketch", len(coarse_samples(found[0].embedding))),
        ("points", len(quantised_points(found[0].embedding))),
        ("ready to be matched", np.mean([match_record(one.embedding, DEFAULT).nbytes for one in found])),
    ):
        print(f"| {name} | {size:,.0f} |")


def stored_in_a_second() -> None:
    """Shapes stored one after another, each in a transaction of its own, which wait for each other."""
    mesh = make_shape("octopus", 0)
    embedded = embed_mesh(mesh, DEFAULT, 0.0)
    data = write_mesh(mesh, "ply")
    print("\n| stored one by one in | shapes/s |\n|---|---:|")
    with tempfile.TemporaryDirectory() as folder:
        for url in (f"sqlite:///{folder}/archive.sqlite3", engines.empty_database()):
            with closing(Database(url, lock_seconds=10, hnsw=HnswParameters())) as database:
                migrate(database)
                begin(Pipelines(DEFAULT), database)
                began = time.perf_counter()
                for number in range(STORED):
                    new = NewShape(
                        data + number.to_bytes(8, "big"),
                        "ply",
                        DEFAULT_COLLECTION.number,
                        str(number),
                        (),
                        {},
                    )
                    with database.write() as session:
                        blob = file_repository.add_blob(session, new.data, new.sha256)
                        file_repository.add_embedding(session, blob, "ply", DEFAULT.fingerprint, embedded)
                        repository.add_shape(session, blob, new, embedded.facts)
                seconds = time.perf_counter() - began
            name = "an SQLite file" if url.startswith("sqlite") else "PostgreSQL, which does not sync here"
            print(f"| {name} | {STORED / seconds:,.0f} |", flush=True)


def made(path: Path, count: int) -> Float32s:
    """The signatures, in a file."""
    rng = np.random.default_rng(0)
    middles = rng.normal(size=(max(1, count // GROUP), LENGTH)).astype(np.float32)
    stored = np.memmap(path, dtype=np.float32, mode="w+", shape=(count, LENGTH))
    for start in range(0, count, AT_ONCE):
        some = rng.integers(len(middles), size=min(AT_ONCE, count - start))
        noise = rng.standard_normal((len(some), LENGTH), dtype=np.float32)
        stored[start : start + len(some)] = middles[some] + np.float32(SPREAD) * noise
    stored.flush()
    return np.memmap(path, dtype=np.float32, mode="c", shape=(count, LENGTH))


def nearest(stored: Float32s, query: Float32s, threads: ThreadPoolExecutor, parts: int) -> NDArray[np.intp]:
    """The places of the nearest, found in so many parts at a time."""
    ends = np.linspace(0, len(stored), parts + 1).astype(int)

    def part(i: int) -> Floats:
        return signature_distances(query, stored[ends[i] : ends[i + 1]])

    distances = np.concatenate(list(threads.map(part, range(parts))))
    return least(distances, np.arange(len(stored)), WANTED)


def truth(stored: Float32s, query: Float32s) -> NDArray[np.intp]:
    """The same by plain computation."""
    squares = [
        ((stored[start : start + AT_ONCE].astype(np.float64) - query) ** 2).sum(axis=1)
        for start in range(0, len(stored), AT_ONCE)
    ]
    return np.argsort(np.concatenate(squares), kind="stable")[:WANTED]


def timed(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def main(count: int, queries: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        of_a_shape(Path(folder))
    stored_in_a_second()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as threads:
        stored = made(Path(folder) / "signatures", count)
        asked = np.array(stored[:: count // queries][:queries]) + np.float32(0.1)
        print(f"\n{count:,} signatures, {stored.nbytes / MIB:,.0f} MiB; the nearest {WANTED:,}, exactly.\n")
        print("| threads | first query, s | median, s | most, s | signatures/s |\n|---|---:|---:|---:|---:|")
        for parts in (1, 2):
            seconds = [
                timed(lambda query=query, parts=parts: nearest(stored, query, threads, parts))
                for query in asked
            ]
            middle = float(np.median(seconds[1:]))
            figures = f"{seconds[0]:.2f} | {middle:.2f} | {max(seconds[1:]):.2f} | {count / middle:,.0f}"
            print(f"| {parts} | {figures} |", flush=True)
        found = nearest(stored, asked[0], threads, 2)
        if not np.array_equal(found, truth(stored, asked[0])):
            raise SystemExit("the nearest are not those of the plain computation")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MIB
        print(f"\nThe nearest are those of a plain computation. Peak memory {peak:,.0f} MiB.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000_000)
    parser.add_argument("--queries", type=int, default=10)
    try:
        main(**vars(parser.parse_args()))
    finally:
        engines.stop()
