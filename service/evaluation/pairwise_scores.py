"""Scores of all pairs of a collection, computed in a pool of processes."""

import pickle
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from core.arrays import Floats
from core.descriptors.registry import DESCRIPTORS, descriptors_of
from core.embedding import Embedding, Scores
from core.errors import CoreError
from core.io import DEFAULT_LIMITS, format_of
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import PairDifferences, differences_of
from core.ranking.diffusion import all_contextual_scores
from core.ranking.kinds import KindCoordinates, kinds_in
from core.ranking.local_density import (
    TYPICAL_NETWORK,
    TYPICAL_SPECTRAL,
    TYPICAL_VIEW,
    all_log_eigenvalues,
    all_views,
    lifted,
    neighbour_distances,
)
from core.serialization import embedding_from_bytes
from service.compute.tasks import embed_file
from service.compute.worker_loop import end_with_parent
from service.index.cache import sampled
from service.settings import available_processors

Argument = TypeVar("Argument")
Result = TypeVar("Result")
Done = Callable[[int], object]
"""Called with the number of finished files or pairs."""

PREPARED_BYTES = 1 << 30
"""Factored splines in a worker's cache: each is used once per row, and some take 80 MB (`--uncapped`)."""


@dataclass(frozen=True, eq=False)
class PairScores:
    """Scores of all pairs of n shapes, each an array of shape (n, n), symmetric.

    `cc`, `ssd` and `sim` are those of `core.embedding.Scores`; `combined` is the log odds of the class
    probability. The diagonal compares each shape with itself.
    """

    cc: Floats
    ssd: Floats
    sim: Floats
    combined: Floats
    differences: PairDifferences

    @cached_property
    def contextual(self) -> Floats:
        """Contextual scores, each row for one query that is left out of the graph; not symmetric."""
        return all_contextual_scores(self.combined)


_pipeline: Pipeline


@contextmanager
def worker_pool(parameters: Parameters, workers: int | None) -> Iterator[Executor]:
    """Yield a pool of processes, one for each processor by default, with one thread and one pipeline each."""
    context = get_context("spawn")
    pool = ProcessPoolExecutor(
        workers or available_processors(), context, initializer=_start_worker, initargs=(parameters,)
    )
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def embed_files(pool: Executor, paths: Sequence[Path], done: Done) -> list[Embedding | str]:
    """Return the embedding of each file, or the reason why there is none."""
    return in_order(pool, _embed, paths, done)


def score_pairs(pool: Executor, embeddings: Sequence[Embedding], done: Done) -> PairScores:
    """Score all pairs. Scores are symmetric, so that each pair is scored once."""
    n = len(embeddings)
    cc, ssd, sim = np.eye(n), np.zeros((n, n)), np.eye(n)
    differences: dict[str, Floats] = defaultdict(lambda: np.zeros((n, n)))
    with stored(list(embeddings)) as path:
        for i, (scores, row) in enumerate(pool.map(partial(_score_row, path), range(n))):
            for matrix, values in ((cc, scores.cc), (ssd, scores.ssd), (sim, scores.sim)):
                matrix[i, i + 1 :] = matrix[i + 1 :, i] = values[1:]
            flat = {name: values for name, values in vars(row).items() if name != "distances"}
            for name, values in (flat | row.distances).items():
                differences[name][i, i:] = differences[name][i:, i] = values
            done(n - 1 - i)
    part = differences.pop("part") > 0.0
    distances = {name: differences.pop(name) for name in DESCRIPTORS}
    distances["eigenvalues"] = np.minimum(distances["eigenvalues"], _kind_distances(embeddings))
    for name, which, typical in (
        ("spectral_density", differences["spectral"], TYPICAL_SPECTRAL),
        ("view_density", distances["views"], TYPICAL_VIEW),
        ("network_density", distances["network_views"], TYPICAL_NETWORK),
    ):
        differences[name] = pair_densities(which, typical, lifts=name != "spectral_density")
    pairs = PairDifferences(**differences, distances=distances, part=part)
    return PairScores(cc, ssd, sim, pooled_log_odds(pairs), pairs)


def pair_densities(distances: Floats, typical: float, *, lifts: bool) -> Floats:
    """Return the geometric means of two shapes' distances to their seventh neighbours, shape (n, n).

    As in the service, neighbours are looked for in a sample of large collections. `typical` is one of
    `core.ranking.local_density`; distances that are not known are NaN. `lifts` tells whether the
    neighbours' distances are `lifted`.
    """
    sample = sampled(np.arange(1, len(distances) + 1))
    unknown = np.isnan(distances) | np.eye(len(distances), dtype=bool)
    others = np.where(unknown, np.inf, distances)[:, sample]
    nearest = neighbour_distances(others, typical)
    known = np.isfinite(others).any(axis=1)
    if lifts and known.any():
        nearest = lifted(nearest, float(np.median(nearest[known])), typical)
    return np.asarray(np.sqrt(np.outer(nearest, nearest)))


def _kind_distances(embeddings: Sequence[Embedding]) -> Floats:
    """Return the distances of n shapes in the metrics of their kinds, shape (n, n), inf between two kinds.

    As in the service, kinds are those in a sample of large collections.
    """
    shapes = [descriptors_of(embedding) for embedding in embeddings]
    logarithms, views = all_log_eigenvalues(shapes), all_views(shapes)
    sample = sampled(np.arange(1, len(shapes) + 1))
    all_kinds = kinds_in(logarithms[sample], views[sample]).of(logarithms)
    each = [KindCoordinates(all_kinds.kinds[[i]], all_kinds.coordinates[[i]]) for i in range(len(embeddings))]
    return np.array([one.distances(all_kinds) for one in each])


@contextmanager
def stored(content: object) -> Iterator[Path]:
    """Yield a temporary file of an object, which each worker reads once instead of once per task."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "content"
        path.write_bytes(pickle.dumps(content))
        yield path


@lru_cache(maxsize=1)
def loaded(path: Path) -> Any:  # noqa: ANN401
    """Return the object in a file of `stored`."""
    return pickle.loads(path.read_bytes())


def reason(error: Exception) -> str:
    """Return why a file has no result. An error of the program is reported too; the evaluation continues."""
    if isinstance(error, CoreError):
        return f"{error.kind}: {error}"
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return f"{type(error).__name__}: {error}"


def in_order(
    pool: Executor, function: Callable[[Argument], Result], arguments: Iterable[Argument], done: Done
) -> list[Result]:
    """Call the function with each argument; return the results in the order of the arguments."""
    results = []
    for result in pool.map(function, arguments):
        results.append(result)
        done(1)
    return results


def _start_worker(parameters: Parameters) -> None:
    global _pipeline  # noqa: PLW0603  a pool's initializer has no other place to leave something
    end_with_parent()
    threadpool_limits(1)
    _pipeline = Pipeline(parameters, memory=PREPARED_BYTES)


def _embed(path: Path) -> Embedding | str:
    try:
        # By the function of the service, so that evaluations measure the same embeddings.
        embedded = embed_file(path.read_bytes(), format_of(path.name), DEFAULT_LIMITS, _pipeline.parameters)
        return embedding_from_bytes(embedded.record)
    except Exception as error:
        return reason(error)


def _score_row(path: Path, i: int) -> tuple[Scores, PairDifferences]:
    """Return the scores and the differences of an embedding with itself and all later ones."""
    others: list[Embedding] = loaded(path)[i:]
    query = others[0]
    scores = _pipeline.score(query, others)
    return scores, differences_of(descriptors_of(query), [descriptors_of(other) for other in others], scores)
