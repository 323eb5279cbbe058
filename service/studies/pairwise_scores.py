"""Scores of all pairs of a collection, computed in a pool of processes."""

import os
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from core.descriptors.descriptor_distance import DescriptorDistance, descriptor_distance
from core.embedding import Embedding, Scores
from core.errors import CoreError
from core.io import DEFAULT_LIMITS, format_of
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.serialization import embedding_from_bytes
from service.compute.tasks import embed_file
from service.compute.worker_loop import end_with_parent

Floats = NDArray[np.float64]
A = TypeVar("A")
R = TypeVar("R")

PREPARED_BYTES = 1 << 30
"""Factored splines in a worker's cache: each is used once per row, and some take 80 MB (`--uncapped`)."""


@dataclass(frozen=True, eq=False)
class PairScores:
    """Scores of all pairs of n shapes, each an array of shape (n, n), symmetric.

    Attributes
    ----------
    cc, ssd, sim : float64
        See `core.embedding.Scores`; the diagonal compares each shape with itself.
    combined : float64
        See `core.pipeline.Pipeline.combined`.
    signatures : float32, shape (n, s)
        Signatures of the shapes.
    descriptor_distance : float64, shape (n, n)
        Distances of their descriptors, symmetric; 0 if the parameters disable them.
    part : bool, shape (n, n)
        Whether one of the two shapes is incomplete.
    """

    cc: Floats
    ssd: Floats
    sim: Floats
    combined: Floats
    signatures: NDArray[np.float32]
    descriptor_distance: Floats
    part: NDArray[np.bool_]


_pipeline: Pipeline


@contextmanager
def worker_pool(parameters: Parameters, workers: int) -> Iterator[Executor]:
    """A pool of processes with one thread and one pipeline each."""
    pool = ProcessPoolExecutor(
        workers, get_context("spawn"), initializer=_start_worker, initargs=(parameters,)
    )
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def embed_files(pool: Executor, paths: Sequence[Path], done: Callable[[int], None]) -> list[Embedding | str]:
    """The embedding of each file, or the reason why there is none; `done` receives the number finished."""
    results: list[Embedding | str] = [""] * len(paths)
    for i, result in _each(pool, _embed, dict(enumerate(paths))):
        results[i] = result
        done(1)
    return results


def score_pairs(
    pool: Executor, pipeline: Pipeline, embeddings: Sequence[Embedding], done: Callable[[int], None]
) -> PairScores:
    """Scores of all pairs. Scores are symmetric, so that each pair is scored once."""
    n = len(embeddings)
    scores = PairScores(
        cc=np.eye(n),
        ssd=np.zeros((n, n)),
        sim=np.eye(n),
        combined=np.zeros((n, n)),
        signatures=np.stack([embedding.signature for embedding in embeddings]),
        descriptor_distance=np.zeros((n, n)),
        part=np.zeros((n, n), dtype=bool),
    )
    with TemporaryDirectory() as folder:
        # Each worker reads the file of all embeddings once, instead of once per row.
        path = Path(folder) / "embeddings"
        path.write_bytes(pickle.dumps(list(embeddings)))
        for i, (row, between) in _each(pool, partial(_score_row, path), {i: i for i in range(n - 1)}):
            for name in ("cc", "ssd", "sim"):
                matrix = getattr(scores, name)
                matrix[i, i + 1 :] = matrix[i + 1 :, i] = getattr(row, name)
            if between is not None:
                scores.descriptor_distance[i, i + 1 :] = scores.descriptor_distance[i + 1 :, i] = (
                    between.distance
                )
                scores.part[i, i + 1 :] = scores.part[i + 1 :, i] = between.part
            done(n - 1 - i)
    spin_images = pipeline.parameters.ranking.spin_images
    for i, signature in enumerate(scores.signatures):
        between = DescriptorDistance(scores.descriptor_distance[i], scores.part[i]) if spin_images else None
        scores.combined[i] = pipeline.combined(
            scores.cc[i], scores.sim[i], signature, scores.signatures, between
        )
    return scores


def default_workers() -> int:
    """The number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start_worker(parameters: Parameters) -> None:
    global _pipeline  # noqa: PLW0603  a pool's initializer has no other place to leave something
    end_with_parent()
    threadpool_limits(1)
    _pipeline = Pipeline(parameters, memory=PREPARED_BYTES)


def _embed(path: Path) -> Embedding | str:
    try:
        # Like the service, so that studies measure the same embeddings.
        embedded = embed_file(path.read_bytes(), format_of(path.name), DEFAULT_LIMITS, _pipeline.parameters)
        return embedding_from_bytes(embedded.record)
    except CoreError as error:
        return f"{error.kind}: {error}"
    except OSError as error:
        return error.strerror or str(error)
    except Exception as error:
        # An error of the program is reported for this file; the study continues.
        return f"{type(error).__name__}: {error}"


def _score_row(path: Path, i: int) -> tuple[Scores, DescriptorDistance | None]:
    own, *others = _load(path)[i:]
    scores = _pipeline.score(own, others)
    return scores, descriptor_distance(
        own.spin_images, [other.spin_images for other in others]
    ) if own.spin_images.size else None


@lru_cache(maxsize=1)
def _load(path: Path) -> list[Embedding]:
    embeddings: list[Embedding] = pickle.loads(path.read_bytes())
    return embeddings


def _each(pool: Executor, function: Callable[[A], R], arguments: Mapping[int, A]) -> Iterator[tuple[int, R]]:
    """Call the function with each argument; yield keys and results in the order of completion."""
    futures = {pool.submit(function, argument): key for key, argument in arguments.items()}
    for future in as_completed(futures):
        yield futures[future], future.result()
