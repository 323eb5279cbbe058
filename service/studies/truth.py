"""Correspondences of a folder of meshes against its truth: vertices of templates in files beside them."""

import csv
from collections.abc import Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np

from core.arrays import Ints
from core.io import format_of, read_mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.studies.correspondence_truth import (
    KnownMesh,
    TruthErrors,
    corresponding_vertices,
    drawn_pairs,
    known_mesh,
    measured_vertices,
    truth_errors,
)
from service.console import progress
from service.datasets import LABELS_FILE, DatasetError
from service.studies.functional_maps import functional_map, spectrum
from service.studies.pairwise_scores import worker_pool

OURS, PLAIN, ORIENTED = "isoshape", "pyfmaps", "pyfmaps_oriented"
"""The methods: ours, and functional maps by pyfmaps without and with their orientation term."""

CACHED = 24
"""Meshes that a worker keeps ready, each of some 20 MB."""

TOGETHER = 5
"""Pairs that a worker matches in one task."""


@dataclass(frozen=True)
class TruthFile:
    """A mesh of a folder with truth, and the template that it shares with others."""

    path: Path
    label: str
    template: str


@dataclass(frozen=True)
class Spread:
    """Mean and median over pairs."""

    mean: float
    median: float

    @classmethod
    def of(cls, errors: list[float]) -> "Spread":
        """Of some errors, at least one."""
        return cls(fmean(errors), median(errors))


@dataclass(frozen=True)
class TruthSummary:
    """Errors over pairs, at least one: see `core.studies.correspondence_truth.TruthErrors`."""

    errors: list[TruthErrors] = field(repr=False)

    @property
    def direct(self) -> Spread:
        """Of the direct errors."""
        return Spread.of([one.direct for one in self.errors])

    @property
    def symmetric(self) -> Spread:
        """Of the errors up to the body's symmetry."""
        return Spread.of([one.symmetric for one in self.errors])

    def as_json(self) -> dict[str, object]:
        """The object that `--json` prints."""
        return {
            "pairs": len(self.errors),
            "direct": asdict(self.direct),
            "symmetric": asdict(self.symmetric),
        }


def read_truth(folder: Path) -> list[TruthFile]:
    """The meshes that `labels.csv` names: columns file and class, and template where classes share one.

    Raises
    ------
    DatasetError
        `labels.csv` cannot be read or lacks a column, or a mesh lacks its `.vts` file.
    """
    labels = folder / LABELS_FILE
    try:
        with labels.open(encoding="utf-8-sig", newline="") as lines:
            rows = list(csv.DictReader(lines))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{labels}: {error}") from error
    files = []
    for row in rows:
        name, label = row.get("file"), row.get("class")
        if not name or not label:
            raise DatasetError(f"{labels}: each row needs a file and a class")
        if not _template_file(folder / name).is_file():
            raise DatasetError(f"{folder / name} has no truth: {_template_file(folder / name).name}")
        files.append(TruthFile(folder / name, label, row.get("template") or label))
    return files


def study_truth(
    files: Sequence[TruthFile], count: int, seed: int, workers: int, methods: Sequence[str]
) -> dict[str, dict[str, TruthSummary | None]]:
    """Errors by method, of pairs of one class ("same") and of two classes with one template ("different").

    Raises
    ------
    DatasetError
        A file of the truth cannot be read, or templates of one name have different sizes.
    CoreError
        A mesh cannot be read or embedded.
    """
    kinds = drawn_pairs([file.label for file in files], [file.template for file in files], count, seed)
    wanted = [pair for pairs in kinds for pair in pairs]
    tasks = [wanted[start : start + TOGETHER] for start in range(0, len(wanted), TOGETHER)]
    found: dict[tuple[int, int], dict[str, TruthErrors]] = {}
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        task = bar.add_task("matching pairs", total=len(wanted))
        futures = {
            pool.submit(_errors, [(files[i].path, files[j].path) for i, j in pairs], seed, methods): pairs
            for pairs in tasks
        }
        for future in as_completed(futures):
            pairs = futures[future]
            found.update(zip(pairs, future.result(), strict=True))
            bar.advance(task, len(pairs))
    return {
        method: {
            kind: TruthSummary([found[pair][method] for pair in pairs]) if pairs else None
            for kind, pairs in zip(("same", "different"), kinds, strict=True)
        }
        for method in methods
    }


def _template_file(path: Path) -> Path:
    return path.with_suffix(".vts")


def _errors(
    pairs: Sequence[tuple[Path, Path]], seed: int, methods: Sequence[str]
) -> list[dict[str, TruthErrors]]:
    return [{method: _errors_by(method, *pair, seed) for method in methods} for pair in pairs]


def _errors_by(method: str, one: Path, other: Path, seed: int) -> TruthErrors:
    if _truth(one).shape != _truth(other).shape:
        raise DatasetError(f"{one} and {other} share a template, but have truths of different lengths")
    first, second = _known(one, seed), _known(other, seed)
    if method == OURS:
        found = corresponding_vertices(first, second, _pipeline())
    else:
        spectra = (_spectrum(path, seed) for path in (one, other))
        found = functional_map(*spectra, oriented=method == ORIENTED)
    return truth_errors(first, second, found)


@cache
def _pipeline() -> Pipeline:
    return Pipeline(DEFAULT)


@lru_cache(maxsize=CACHED)
def _known(path: Path, seed: int) -> KnownMesh:
    truth = _truth(path)
    mesh = read_mesh(path.read_bytes(), format_of(path.name))
    return known_mesh(mesh, truth[:, measured_vertices(truth.shape[1], seed)], _pipeline())


@lru_cache(maxsize=CACHED)
def _truth(path: Path) -> Ints:
    """The vertices, from 0, of all vertices of the template, and of their mirror images if they are known."""
    direct, mirror = _template_file(path), path.with_suffix(".sym.vts")
    rows = [_read_vertices(each) for each in (direct, mirror) if each == direct or each.is_file()]
    if len({len(row) for row in rows}) > 1:
        raise DatasetError(f"{direct} and {mirror.name} have different lengths")
    return np.stack(rows) - 1


@lru_cache(maxsize=CACHED)
def _spectrum(path: Path, seed: int) -> Any:  # noqa: ANN401  of pyfmaps
    return spectrum(_known(path, seed).mesh)


def _read_vertices(path: Path) -> Ints:
    try:
        return np.loadtxt(path, dtype=np.int64, ndmin=1)
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path}: {error}") from error
