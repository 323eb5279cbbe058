"""The cost of the method: embedding, its growth with the size of a mesh, and one match of two shapes."""

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import chain, pairwise
from math import floor, log10
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from core.embedding import Embedding
from core.io import format_of, read_mesh, write_mesh
from core.matching.match_records import match_record, score_match_records
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.reranking import coarse_samples, rerank
from core.serialization import embedding_from_bytes, embedding_to_bytes
from service.evaluation.benchmark_shapes import NamedMesh, Source, nearest, resized, shaken

EMBEDDED, MESHES, EMBEDDINGS = 3000, 5, 9
"""Vertices, meshes, and measurements of each mesh."""

SIZES, RUNS = (3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000), 3
"""Vertices of the meshes whose embeddings show the growth, and runs of each."""

FORMATS = ("ply", "stl", "glb")

MATCHED, PAIRS, MATCHES = 2800, 3, 200
"""Vertices of matched meshes, pairs, and measurements of each pair."""

MANY = 64
"""Shapes that one is matched with in one call: the second of the pair, each with other noise."""


@dataclass(frozen=True)
class Spread:
    """Median, first quartile `low` and third quartile `high` of `count` measurements."""

    median: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Summarise one or more values."""
        low, median, high = np.percentile(values, [25.0, 50.0, 75.0])
        return cls(float(median), float(low), float(high), len(values))

    def __str__(self) -> str:
        return f"{digits(self.median)} ({digits(self.low)} to {digits(self.high)})"


def digits(value: float) -> str:
    """Format a number with three significant digits, or as many as it has before the point."""
    places = 2 - floor(log10(abs(value))) if value else 0
    return f"{value:,.{min(max(0, places), 6)}f}"


def all_meshes(source: Source) -> list[NamedMesh]:
    """Return all meshes with their names, class by class."""
    return [*chain.from_iterable(source.values())]


def embedding_rows(
    source: Source, *, vertices: int = EMBEDDED, meshes: int = MESHES, repeats: int = EMBEDDINGS
) -> list[dict[str, Any]]:
    """Measure from the bytes of a binary PLY to the embedding, for meshes of about so many vertices."""
    method = Pipeline(DEFAULT)
    rows = []
    for name, mesh in nearest(all_meshes(source), vertices, meshes):
        data = write_mesh(mesh, "ply")
        # The first measurement is a warm-up.
        times = [1e3 * embedding_seconds(method, data, "ply") for _ in range(repeats + 1)][1:]
        rows.append({"mesh": name, "vertices": len(mesh.vertices), "milliseconds": Spread.of(times)})
    return rows


def embedding_seconds(method: Pipeline, data: bytes, format: str) -> float:
    """Return the seconds from the bytes of a file to its embedding."""
    return _seconds(lambda: method.embed(read_mesh(data, format)))


def growth_rows(
    source: Source, scratch: Path, *, sizes: Sequence[int] = SIZES, runs: int = RUNS
) -> list[dict[str, Any]]:
    """Measure one mesh at each size as PLY, and the largest in every format, each in a new process.

    The seconds are from bytes to embedding, the peak is that of the process's memory, libraries included.
    """
    # The class is "quadruped" among made shapes, and "fourleg" in the Princeton Segmentation Benchmark.
    four_legged = source.get("fourleg") or source.get("quadruped")
    _, mesh = (four_legged or nearest(all_meshes(source), sizes[0], 1))[0]
    rows = []
    for size in sizes:
        scaled = resized(mesh, size)
        for format in FORMATS if size == sizes[-1] else FORMATS[:1]:
            path = scratch / f"{size}.{format}"
            path.write_bytes(write_mesh(scaled, format))
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                seconds, peak = pool.submit(measure_file, str(path), runs).result()
            row: dict[str, Any] = {"vertices": len(scaled.vertices), "faces": len(scaled.faces)}
            row |= {"file_bytes": path.stat().st_size, "format": format}
            rows.append(row | {"seconds": Spread.of(seconds), "peak_bytes": peak})
            path.unlink()
    return rows


def growth_exponents(rows: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Return the exponents of seconds and of peak memory as powers of the vertices, over PLY files.

    They are slopes of the logarithms, by least squares, for two or more sizes.
    """
    shown = [row for row in rows if row["format"] == FORMATS[0]]
    sizes = np.log([row["vertices"] for row in shown])
    costs = np.log([(row["seconds"].median, row["peak_bytes"]) for row in shown])
    seconds, memory = np.polyfit(sizes, costs, 1)[0].tolist()
    return seconds, memory


def measure_file(path: str, runs: int) -> tuple[list[float], int]:
    """Embed a file several times in this process: return seconds of each run, and the peak memory."""
    data = Path(path).read_bytes()
    method = Pipeline(DEFAULT)
    return [embedding_seconds(method, data, format_of(path)) for _ in range(runs)], peak_memory()


def peak_memory() -> int:
    """Return the peak memory of this process, in bytes.

    Not from getrusage, which counts what the parent held when it forked.
    """
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])


def matching_rows(
    source: Source, *, vertices: int = MATCHED, pairs: int = PAIRS, repeats: int = MATCHES
) -> list[dict[str, Any]]:
    """Measure `match_steps` of `neighbours`; the first fifth of the measurements is a warm-up.

    A source without two meshes of a class gives no row.
    """
    method = Pipeline(DEFAULT)
    rows = []
    with threadpool_limits(limits=1):
        for (first, mesh), (second, other) in pairwise(neighbours(source, vertices, pairs + 1)):
            steps = match_steps(method.embed(mesh), method.embed(other), method)
            times = [[step() for step in steps.values()] for _ in range(repeats + repeats // 5 + 1)]
            spreads = map(Spread.of, (1e3 * np.array(times[-repeats:])).T.tolist())
            rows.append({"first": first, "second": second, **dict(zip(steps, spreads, strict=True))})
    return rows


def match_steps(query: Embedding, candidate: Embedding, method: Pipeline) -> dict[str, Callable[[], float]]:
    """Return functions that run steps of matching, both ways in every embedding, and return their seconds.

    One of `MANY` in a query: the match `one_of_many`, and `reranking`. One match by `Pipeline.score`, which
    hashes both embeddings to look up its caches: `score`. From the bytes of two stored embeddings to CC, SSD
    and sim without any cache: `decode`, `pack` (their match records) and `match`.
    """
    copies = [candidate, *(shaken(candidate, number) for number in range(1, MANY))]
    packed = match_record(query, DEFAULT)
    candidates = [match_record(copy, DEFAULT) for copy in copies]
    samples = np.stack([coarse_samples(copy) for copy in copies])
    stored = [embedding_to_bytes(embedding) for embedding in (query, candidate)]
    embeddings = [embedding_from_bytes(record) for record in stored]
    records = [match_record(embedding, DEFAULT) for embedding in embeddings]
    return {
        "one_of_many": lambda: _seconds(lambda: score_match_records(packed, candidates, DEFAULT)) / MANY,
        "reranking": lambda: _seconds(lambda: rerank(packed, samples, DEFAULT)) / MANY,
        "score": lambda: _seconds(lambda: method.score(query, [candidate])),
        "decode": lambda: _seconds(lambda: [embedding_from_bytes(record) for record in stored]),
        "pack": lambda: _seconds(lambda: [match_record(embedding, DEFAULT) for embedding in embeddings]),
        "match": lambda: _seconds(lambda: score_match_records(records[0], records[1:], DEFAULT)),
    }


def neighbours(source: Source, vertices: int, count: int) -> list[NamedMesh]:
    """Return at most `count` meshes of about `vertices` vertices, two of each class.

    Consecutive pairs are alternately of one class and of two. The classes whose second mesh is nearest in
    size come first.
    """
    twos = [nearest(meshes, vertices, 2) for meshes in source.values() if len(meshes) > 1]
    twos.sort(key=lambda two: abs(len(two[1][1].vertices) - vertices))
    return [(name, resized(mesh, vertices)) for name, mesh in [*chain.from_iterable(twos)][:count]]


def _seconds(work: Callable[[], object]) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start
