"""All pairs of a collection, scored in a pool of processes."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from core.embedding import Embedding, Scores
from core.errors import CoreError
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.reading import format_of, read_mesh

Floats = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class PairScores:
    """Scores of all pairs of n shapes, each array of shape (n, n) and symmetric.

    Attributes
    ----------
    cc, ssd, sim : float64
        As in `core.embedding.Scores`; the diagonal holds a shape against itself.
    distances : float64
        Between signatures.
    """

    cc: Floats
    ssd: Floats
    sim: Floats
    distances: Floats


@dataclass(frozen=True)
class _Worker:
    """What each process of the pool keeps: the pipeline, and for scoring all embeddings, sent once."""

    pipeline: Pipeline
    embeddings: Sequence[Embedding]


_worker: _Worker


def embed_files(
    paths: Sequence[Path], parameters: Parameters, workers: int, done: Callable[[int], None]
) -> list[Embedding | str]:
    """The embedding of each file, or why there is none; `done` is told how many more are finished."""
    results: list[Embedding | str] = [""] * len(paths)
    with _pool(workers, parameters, ()) as pool:
        for i, result in _each(pool, _embed, range(len(paths)), paths):
            results[i] = result
            done(1)
    return results


def score_pairs(
    embeddings: Sequence[Embedding], parameters: Parameters, workers: int, done: Callable[[int], None]
) -> PairScores:
    """Scores of all pairs; each pair is scored once, since scores are symmetric."""
    n = len(embeddings)
    pipeline = Pipeline(parameters)
    signatures = np.stack([embedding.signature for embedding in embeddings])
    scores = PairScores(
        cc=np.eye(n),
        ssd=np.zeros((n, n)),
        sim=np.eye(n),
        distances=np.stack([pipeline.signature_distances(row, signatures) for row in signatures]),
    )
    with _pool(workers, parameters, embeddings) as pool:
        for i, row in _each(pool, _score_row, range(n - 1), range(n - 1)):
            for name in ("cc", "ssd", "sim"):
                matrix = getattr(scores, name)
                matrix[i, i + 1 :] = matrix[i + 1 :, i] = getattr(row, name)
            done(n - 1 - i)
    return scores


def default_workers() -> int:
    """As many as this process may use processors."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _embed(path: Path) -> Embedding | str:
    try:
        return _worker.pipeline.embed(read_mesh(path.read_bytes(), format_of(path.name)))
    except CoreError as error:
        return f"{error.kind}: {error}"
    except OSError as error:
        return error.strerror or str(error)


def _score_row(i: int) -> Scores:
    return _worker.pipeline.score(_worker.embeddings[i], _worker.embeddings[i + 1 :])


def _start_worker(parameters: Parameters, embeddings: Sequence[Embedding]) -> None:
    global _worker  # noqa: PLW0603  a pool's initializer has no other place to leave something
    threadpool_limits(1)
    _worker = _Worker(Pipeline(parameters), embeddings)


@contextmanager
def _pool(workers: int, parameters: Parameters, embeddings: Sequence[Embedding]) -> Iterator[Executor]:
    pool = ProcessPoolExecutor(
        workers, get_context("spawn"), initializer=_start_worker, initargs=(parameters, embeddings)
    )
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _each(
    pool: Executor, function: Callable[[Any], T], keys: Iterable[int], arguments: Iterable[Any]
) -> Iterator[tuple[int, T]]:
    """Run the function on each argument; yield key and result as they finish, whatever the order."""
    futures = {pool.submit(function, argument): key for key, argument in zip(keys, arguments, strict=True)}
    for future in as_completed(futures):
        yield futures[future], future.result()
