"""Perturbed files as queries to the clean shapes of a collection, in a pool of processes."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from zlib import crc32

import numpy as np

from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.embedding import Embedding, Scores
from core.io import format_of, read_mesh
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.differences import PairDifferences, differences_of
from core.ranking.local_density import DensitySample, LocalDensities, densities_in, density_sample
from service.evaluation.pairwise_scores import Done, embed_files, loaded, reason

Told = Callable[[str], object]
"""Called with the reason why a file cannot be used."""
Perturb = Callable[[Mesh, float, int], Mesh]
"""A function of a mesh, an amount and a seed, as in `core.evaluation.perturbation`."""


@dataclass(frozen=True, eq=False)
class Gallery:
    """The clean shapes that have an embedding: files, their classes, and their embeddings."""

    files: tuple[Path, ...]
    labels: tuple[str, ...]
    embeddings: tuple[Embedding, ...]


def clean_gallery(pool: Executor, files: Sequence[tuple[Path, str]], tell: Told, done: Done) -> Gallery:
    """Return the files that can be embedded; `tell` receives the reason for each of the others."""
    results = embed_files(pool, [path for path, _ in files], done)
    kept: list[tuple[Path, str, Embedding]] = []
    for (path, label), result in zip(files, results, strict=True):
        if isinstance(result, str):
            tell(f"{path}: {result}")
        else:
            kept.append((path, label, result))
    paths, labels, embeddings = zip(*kept, strict=True) if kept else ((), (), ())
    return Gallery(tuple(paths), tuple(labels), tuple(embeddings))


@dataclass(frozen=True, eq=False)
class ScoredQuery:
    """A perturbed shape and its embedding, and its scores and differences to each embedding of the gallery.

    The differences have the local densities among the gallery.
    """

    pipeline: Pipeline
    mesh: Mesh
    query: Embedding
    gallery: list[Embedding]
    scores: Scores
    differences: PairDifferences


def perturbed_query(
    embeddings: Path, perturb: Perturb, amount: float, seed: int, path: Path
) -> ScoredQuery | str:
    """Return a perturbed file as a query, or the reason why it cannot be one.

    Parameters
    ----------
    embeddings : Path
        The file of a gallery's list of embeddings, by `service.evaluation.pairwise_scores.stored`.
    perturb : Perturb
    amount : float
    seed : int
        Of the run; each file has its own random numbers, which depend on its name.
    path : Path
        The file that is perturbed.
    """
    pipeline, (gallery, described, sample, densities) = _pipeline(), _load(embeddings)
    try:
        cleaned = clean(read_mesh(path.read_bytes(), format_of(path.name))).mesh
        mesh = perturb(cleaned, amount, seed_of(path, seed))
        query = pipeline.embed(mesh)
        scores = pipeline.score(query, gallery)
        descriptors = descriptors_of(query)
        density = densities_in(sample, [descriptors])
        differences = differences_of(descriptors, described, scores, density, densities)
        return ScoredQuery(pipeline, mesh, query, gallery, scores, differences)
    except Exception as error:
        return reason(error)


def seed_of(path: Path, seed: int) -> int:
    """Return the seed of one shape in one run, which depends on the name of its file alone."""
    return int(np.random.SeedSequence([seed, crc32(path.name.encode())]).generate_state(1)[0])


@lru_cache(maxsize=1)
def _pipeline() -> Pipeline:
    return Pipeline(DEFAULT)


@lru_cache(maxsize=1)
def _load(path: Path) -> tuple[list[Embedding], list[ShapeDescriptors], DensitySample, LocalDensities]:
    """Return the embeddings of a gallery, their descriptors, a sample of these, and their densities in it."""
    embeddings: list[Embedding] = loaded(path)
    descriptors = [descriptors_of(embedding) for embedding in embeddings]
    sample = density_sample(descriptors)
    return embeddings, descriptors, sample, densities_in(sample, descriptors)
