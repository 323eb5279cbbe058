"""Correspondences of a folder of meshes against its truth: vertices of templates in files beside them."""

from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path
from statistics import fmean, median
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from core.arrays import Ints
from core.evaluation.correspondence_errors import (
    KnownMesh,
    dense_map,
    drawn_pairs,
    known_mesh,
    measured_vertices,
    truth_errors,
)
from core.io import format_of, read_mesh
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.console import counted, progress
from service.datasets import LABELS_FILE, DatasetError, MeshFile, read_labels
from service.evaluation.pairwise_scores import worker_pool

OURS, PLAIN, ORIENTED = "isoshape", "pyfmaps", "pyfmaps_oriented"
"""The methods: ours, and functional maps by pyfmaps without and with their orientation term."""

EIGENVALUES = 200
"""Number of eigenvalues that pyfmaps computes by default."""

ORIENTATION_WEIGHT = 0.1
"""Weight of the orientation term of pyfmaps where it is used; other weights are the library's defaults."""

CACHED = 24
"""Meshes that a worker keeps ready, each of some 20 MB."""

TOGETHER = 5
"""Pairs that a worker matches in one task."""

KINDS = ("same", "different")
"""Pairs of one class, and of two classes with one template."""


class TimedErrors(NamedTuple):
    """The errors of a map as in `core.evaluation.correspondence_errors.TruthErrors`, and its processor time.

    Embeddings and eigenfunctions, computed once for each mesh, are not in the time.
    """

    direct: float
    symmetric: float
    seconds: float


def summary(errors: Sequence[TimedErrors]) -> dict[str, Any]:
    """Return the number of pairs, and mean and median of both errors and of the time; at least one pair."""
    values = {name: [getattr(pair, name) for pair in errors] for name in TimedErrors._fields}
    figures = {name: {"mean": fmean(each), "median": median(each)} for name, each in values.items()}
    return {"pairs": len(errors), **figures}


def read_truth(folder: Path) -> list[MeshFile]:
    """Return the meshes that `labels.csv` names, which have a class, and a template where classes share one.

    Raise DatasetError if `labels.csv` cannot be used, or a mesh lacks its `.vts` file.
    """
    files = read_labels(folder / LABELS_FILE)
    for file in files:
        if not file.path.with_suffix(".vts").is_file():
            raise DatasetError(f"{file.path} has no truth: {file.path.stem}.vts")
    return files


def study_truth(
    files: Sequence[MeshFile], count: int, seed: int, workers: int | None, methods: Sequence[str]
) -> dict[str, dict[str, list[TimedErrors]]]:
    """Return the errors of pairs by method and kind of pair; see `KINDS`.

    Raise DatasetError if a file of the truth cannot be read, or templates of one name have different sizes,
    and CoreError if a mesh cannot be read or embedded.
    """
    classes, templates = [str(file.label) for file in files], [str(file.template) for file in files]
    drawn = drawn_pairs(classes, templates, count, seed)
    pairs = [(i, j) for kind in drawn for i, j in kind]
    lengths = {i: _truth(files[i].path).shape for i in sorted({i for pair in pairs for i in pair})}
    for i, j in pairs:
        if lengths[i] != lengths[j]:
            raise DatasetError(
                f"{files[i].path} and {files[j].path} share a template, but have truths of different lengths"
            )
    tasks = [pairs[start : start + TOGETHER] for start in range(0, len(pairs), TOGETHER)]
    arguments = [([(files[i].path, files[j].path) for i, j in task], seed, tuple(methods)) for task in tasks]
    errors: dict[tuple[int, int], dict[str, TimedErrors]] = {}
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        done = counted(bar, "matching pairs", len(pairs))
        for task, results in zip(tasks, pool.map(_errors, arguments), strict=True):
            errors.update(zip(task, results, strict=True))
            done(len(results))
    kinds = dict(zip(KINDS, drawn, strict=True))
    return {
        method: {kind: [errors[pair][method] for pair in pairs] for kind, pairs in kinds.items()}
        for method in methods
    }


def _errors(task: tuple[Sequence[tuple[Path, Path]], int, Sequence[str]]) -> list[dict[str, TimedErrors]]:
    pairs, seed, methods = task
    return [{method: _errors_by(method, *pair, seed) for method in methods} for pair in pairs]


def _errors_by(method: str, first_path: Path, second_path: Path, seed: int) -> TimedErrors:
    first, second = known_of(first_path, seed), known_of(second_path, seed)
    if method == OURS:
        start = process_time()
        _, targets = dense_map(first, second, _pipeline())
    else:
        spectra = [_spectrum(path, seed) for path in (second_path, first_path)]
        start = process_time()
        targets = np.asarray(functional_map(*spectra, oriented=method == ORIENTED).get_p2p(), dtype=np.int64)
    seconds = process_time() - start
    errors = truth_errors(first, second, targets)
    return TimedErrors(errors.direct, errors.symmetric, seconds)


@cache
def _pipeline() -> Pipeline:
    return Pipeline(DEFAULT)


@lru_cache(maxsize=CACHED)
def known_of(path: Path, seed: int) -> KnownMesh:
    """Return a mesh that is ready to be matched, with the truth at vertices that a seed draws."""
    truth = _truth(path)
    mesh = read_mesh(path.read_bytes(), format_of(path.name))
    return known_mesh(mesh, truth[:, measured_vertices(truth.shape[1], seed)], _pipeline())


@lru_cache(maxsize=CACHED)
def _truth(path: Path) -> Ints:
    """Return the vertices, from 0, of all vertices of the template, and of their mirror images if known."""
    mirror = path.with_suffix(".sym.vts")
    rows = []
    for file in (path.with_suffix(".vts"), *([mirror] if mirror.is_file() else [])):
        try:
            rows.append(np.loadtxt(file, dtype=np.int64, ndmin=1))
        except (OSError, ValueError) as error:
            raise DatasetError(f"{file}: {error}") from error
    if len({len(row) for row in rows}) > 1:
        raise DatasetError(f"{path.with_suffix('.vts')} and {mirror.name} have different lengths")
    return np.stack(rows) - 1


@lru_cache(maxsize=CACHED)
def _spectrum(path: Path, seed: int) -> Any:  # noqa: ANN401  of pyfmaps
    return spectrum(known_of(path, seed).mesh)


def spectrum(mesh: Mesh) -> Any:  # noqa: ANN401  the library's own
    """Return eigenfunctions by pyfmaps of the robust Laplacian; the plain one wants no face without area."""
    from pyFM.mesh import TriMesh  # noqa: PLC0415  optional

    surface = TriMesh(mesh.vertices.copy(), mesh.faces.copy(), area_normalize=True, center=True)
    return surface.process(EIGENVALUES, robust=True)


def functional_map(source: Any, target: Any, *, oriented: bool = False) -> Any:  # noqa: ANN401  the library's own
    """Return pyfmaps' model of the map between two meshes of `spectrum`, with the library's default options.

    It is fitted to wave kernel signatures, with the term that preserves orientation if `oriented`, and
    refined by ZoomOut; its point map gives a vertex of the source for each vertex of the target.
    """
    from pyFM.functional import FunctionalMapping  # noqa: PLC0415  optional

    model = FunctionalMapping(source, target)
    model.preprocess(k_process=EIGENVALUES)
    model.fit(w_orient=ORIENTATION_WEIGHT if oriented else 0)
    model.zoomout_refine()
    return model
