"""Perturbed queries against a clean gallery (`core.studies.robustness`), in a pool of processes."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np

from core.arrays import Floats
from core.descriptors.descriptor_distance import is_part, whole_spin_images
from core.descriptors.partial_matching import describe_part, part_distances
from core.descriptors.spin_images import KEYPOINTS
from core.embedding import Embedding, Scores
from core.errors import CoreError
from core.io import format_of, read_mesh
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.density_sample import DensitySample, densities_in, density_sample
from core.ranking.local_density import LocalDensities
from core.ranking.opinion_pool import pooled_log_odds
from core.ranking.pair_differences import PairDifferences, ShapeDescriptors, descriptors_of, differences_of
from core.studies.robustness import TAU, Level, Perturbation, Retrieval, nearest_neighbour, tau_parameters
from service.studies.pairwise_scores import embed_files, score_pairs, worker_pool

Told = Callable[[str], None]
Done = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class Gallery:
    """The clean shapes that have an embedding.

    Attributes
    ----------
    files : tuple of Path
    labels : tuple of str
        Classes of the shapes.
    embeddings : tuple of Embedding
    """

    files: tuple[Path, ...]
    labels: tuple[str, ...]
    embeddings: tuple[Embedding, ...]


def clean_gallery(pool: Executor, files: Sequence[tuple[Path, str]], tell: Told, done: Done) -> Gallery:
    """The files that can be embedded; `tell` receives the reason for each of the others."""
    results = embed_files(pool, [path for path, _ in files], done)
    kept: list[tuple[Path, str, Embedding]] = []
    for (path, label), result in zip(files, results, strict=True):
        if isinstance(result, str):
            tell(f"{path}: {result}")
        else:
            kept.append((path, label, result))
    paths, labels, embeddings = zip(*kept, strict=True) if kept else ((), (), ())
    return Gallery(tuple(paths), tuple(labels), tuple(embeddings))


def clean_retrieval(pool: Executor, gallery: Gallery, done: Done) -> Retrieval:
    """Each clean shape as a query against all others."""
    scores = score_pairs(pool, Pipeline(DEFAULT), gallery.embeddings, done)
    everything = np.ones(scores.cc.shape, dtype=bool)
    return nearest_neighbour({"cc": scores.cc, "combined": scores.combined}, everything, gallery.labels)


@contextmanager
def on_disk(gallery: Gallery) -> Iterator[Path]:
    """A temporary file of the gallery, which each worker reads once."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "gallery"
        path.write_bytes(pickle.dumps(list(gallery.embeddings)))
        yield path


def perturbed_level(
    pool: Executor,
    gallery: Gallery,
    stored: Path,
    kind: Perturbation,
    amount: float,
    seeds: int,
    tell: Told,
    done: Done,
) -> Level:
    """Each perturbed shape as a query against all clean ones; `stored` is the file of `on_disk`."""
    runs, own, unusable = [], [], []
    count = len(gallery.files)
    for seed in range(1 if amount in kind.certain else seeds):
        names = ("cc", "combined", "part") if kind.part else ("cc", "combined")
        likeness = {name: np.zeros((count, count)) for name in names}
        scored = np.zeros((count, count), dtype=bool)
        query = partial(_query, stored, kind, amount, seed)
        futures = {pool.submit(query, path): i for i, path in enumerate(gallery.files)}
        for future in as_completed(futures):
            i, row = futures[future], future.result()
            if isinstance(row, str):
                tell(f"{gallery.files[i]}, {kind.title} {100 * amount:g} %: {row}")
            else:
                for name, found in row.items():
                    likeness[name][i] = found
                scored[i] = True
            done(1)
        runs.append(nearest_neighbour(likeness, scored, gallery.labels))
        mine = np.diagonal(likeness["cc"])[np.diagonal(scored)]
        own.append(float(mine.mean()) if len(mine) else 0.0)
        unusable.append(count - len(mine))
    return Level(kind.name, amount, tuple(runs), tuple(own), tuple(unusable))


def tau_level(gallery: Gallery, tau: float, workers: int, tell: Told, done: Done) -> Level:
    """Gallery and queries embedded under a sparse ratio; `done` is called twice for each shape."""
    parameters = tau_parameters(tau)
    count = len(gallery.files)
    likeness = {name: np.zeros((count, count)) for name in ("cc", "combined")}
    scored = np.zeros((count, count), dtype=bool)
    with worker_pool(parameters, workers) as pool:
        files = list(zip(gallery.files, gallery.labels, strict=True))
        found = clean_gallery(pool, files, lambda reason: tell(f"tau {tau}: {reason}"), done)
        if found.embeddings:
            scores = score_pairs(pool, Pipeline(parameters), found.embeddings, lambda _: None)
            places = [gallery.files.index(path) for path in found.files]
            grid = np.ix_(places, places)
            likeness["cc"][grid], likeness["combined"][grid] = scores.cc, scores.combined
            scored[grid] = True
    done(count)
    run = nearest_neighbour(likeness, scored, gallery.labels)
    return Level(TAU, tau, (run,), (), (count - len(found.files),))


def seed_of(path: Path, seed: int) -> int:
    """The seed of one shape in one run, which depends on the name of its file alone."""
    return int(np.random.SeedSequence([seed, crc32(path.name.encode())]).generate_state(1)[0])


@dataclass(frozen=True, eq=False)
class GalleryDescriptors:
    """The clean shapes as perturbed queries are compared with them.

    Attributes
    ----------
    embeddings : list of Embedding
    descriptors : list of ShapeDescriptors
    sample : DensitySample
        Of all clean shapes.
    densities : LocalDensities
        Of each of them among the others.
    """

    embeddings: list[Embedding]
    descriptors: list[ShapeDescriptors]
    sample: DensitySample
    densities: LocalDensities


@dataclass(frozen=True, eq=False)
class ScoredQuery:
    """A perturbed shape, and its similarity to each clean shape.

    Attributes
    ----------
    pipeline : Pipeline
    mesh : Mesh
    query : Embedding
        Embedding of the mesh.
    gallery : GalleryDescriptors
    scores : Scores
    differences : PairDifferences
        With the local densities among the gallery.
    """

    pipeline: Pipeline
    mesh: Mesh
    query: Embedding
    gallery: GalleryDescriptors
    scores: Scores
    differences: PairDifferences


def perturbed_query(
    stored: Path, kind: Perturbation, amount: float, seed: int, path: Path
) -> ScoredQuery | str:
    """A perturbed file as a query to the gallery, or the reason why it cannot be."""
    pipeline, gallery = _pipeline(), _load(stored)
    try:
        mesh = kind.perturb(_clean(path), amount, seed_of(path, seed))
        query = pipeline.embed(mesh)
        scores = pipeline.score(query, gallery.embeddings)
        own = descriptors_of(query)
        density = densities_in(gallery.sample, [own])
        differences = differences_of(own, gallery.descriptors, scores, density, gallery.densities)
        return ScoredQuery(pipeline, mesh, query, gallery, scores, differences)
    except CoreError as error:
        return f"{error.kind}: {error}"
    except Exception as error:
        # An error of the program is reported for this mesh; the study continues.
        return f"{type(error).__name__}: {error}"


def _query(stored: Path, kind: Perturbation, amount: float, seed: int, path: Path) -> dict[str, Floats] | str:
    """The similarity of a perturbed file to each clean shape, (n,) by score; or why there is none."""
    asked = perturbed_query(stored, kind, amount, seed, path)
    if isinstance(asked, str):
        return asked
    pipeline, query, gallery = asked.pipeline, asked.query, asked.gallery.embeddings
    found = {"cc": asked.scores.cc, "combined": pooled_log_odds(asked.differences)}
    if kind.part:
        part = (
            query.spin_images[KEYPOINTS:]
            if is_part(query.spin_images)
            else describe_part(pipeline.open_surface(asked.mesh))
        )
        found["part"] = -part_distances(part, [whole_spin_images(one.spin_images) for one in gallery])
    return found


def _clean(path: Path) -> Mesh:
    return clean(read_mesh(path.read_bytes(), format_of(path.name))).mesh


@lru_cache(maxsize=1)
def _pipeline() -> Pipeline:
    return Pipeline(DEFAULT)


@lru_cache(maxsize=1)
def _load(stored: Path) -> GalleryDescriptors:
    embeddings: list[Embedding] = pickle.loads(stored.read_bytes())
    descriptors = [descriptors_of(embedding) for embedding in embeddings]
    sample = density_sample(descriptors)
    return GalleryDescriptors(embeddings, descriptors, sample, densities_in(sample, descriptors))
