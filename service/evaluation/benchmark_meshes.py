"""Helpers that benchmarks share: meshes of the sizes wanted, repeated measurements, and rows as text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor, log10
from pathlib import Path

import fast_simplification
import numpy as np

from core.evaluation.perturbation import subdivide
from core.gallery import CLASSES, make_shape
from core.io import format_of, read_mesh
from core.mesh.mesh import Mesh
from service.datasets import read_collection

MADE_POSES = 3

MADE = {"human": "person", "fourleg": "quadruped", "airplane": "plane"}
"""Generated classes that replace classes of the Princeton Segmentation Benchmark with other names."""

NEAR = 0.15
"""The tolerated relative error of a number of vertices."""


@dataclass(frozen=True)
class Source:
    """Named meshes by class; classes are in lower case."""

    classes: Mapping[str, list[tuple[str, Mesh]]]

    @property
    def meshes(self) -> list[tuple[str, Mesh]]:
        """All meshes with their names, class by class."""
        return [entry for meshes in self.classes.values() for entry in meshes]

    def of(self, label: str) -> list[tuple[str, Mesh]]:
        """Return the meshes of a class, or of the generated class that replaces it, if there are any."""
        return self.classes.get(label) or self.classes.get(MADE.get(label, label), [])

    def nearest(self, vertices: int, count: int) -> list[tuple[str, Mesh]]:
        """Return the meshes with the nearest numbers of vertices."""
        return sorted(self.meshes, key=lambda entry: abs(len(entry[1].vertices) - vertices))[:count]


def read_source(folder: Path | None) -> Source:
    """Return the meshes of a labelled folder, or generated ones.

    Raises
    ------
    DatasetError, MeshError
        The folder or one of its files cannot be read.
    """
    classes: dict[str, list[tuple[str, Mesh]]] = {}
    if folder is None:
        for label in CLASSES:
            classes[label] = [(f"{label} {pose}", make_shape(label, pose)) for pose in range(MADE_POSES)]
        return Source(classes)
    for path, label in read_collection(folder):
        mesh = read_mesh(path.read_bytes(), format_of(path.name))
        classes.setdefault(label.casefold(), []).append((path.name, mesh))
    return Source(classes)


def resized(mesh: Mesh, vertices: int) -> Mesh:
    """Subdivide the surface, then simplify it to about a number of vertices."""
    while len(mesh.vertices) < (1.0 - NEAR) * vertices:
        mesh = subdivide(mesh, 1.0, 0)
    if len(mesh.vertices) <= (1.0 + NEAR) * vertices:
        return mesh
    points, faces = fast_simplification.simplify(
        np.array(mesh.vertices),
        mesh.faces.astype(np.int32),
        target_reduction=1.0 - vertices / len(mesh.vertices),
    )
    return Mesh(points, faces)


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


def growth_exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Return the exponent b of values = a sizes^b, by least squares of logarithms, for two or more sizes."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def digits(value: float) -> str:
    """Format a number with three significant digits, or as many as it has before the point."""
    places = 2 - floor(log10(abs(value))) if value else 0
    return f"{value:,.{min(max(0, places), 6)}f}"


def cell_of(value: object) -> str:
    """Return a value of a benchmark as the cell of a table."""
    match value:
        case None:
            return "all"
        case bool():
            return "yes" if value else "no"
        case float():
            return digits(value)
        case int():
            return f"{value:,}"
        case dict():
            return ", ".join(f"{name} {cell_of(part)}" for name, part in value.items())
        case _:
            return str(value)
