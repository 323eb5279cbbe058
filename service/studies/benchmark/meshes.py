"""The meshes of the measurements: from a collection or generated, at the sizes wanted."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import fast_simplification
import numpy as np

from core.gallery import CLASSES, make_shape
from core.io import format_of, read_mesh
from core.mesh.mesh import Mesh
from core.studies.perturbation import subdivide
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

    def of(self, label: str) -> list[tuple[str, Mesh]]:
        """The meshes of a class, or of the generated class that replaces it; empty if there is none."""
        return self.classes.get(label) or self.classes.get(MADE.get(label, label), [])

    def nearest(self, vertices: int, count: int) -> list[tuple[str, Mesh]]:
        """The meshes with the nearest numbers of vertices."""
        everything = [entry for meshes in self.classes.values() for entry in meshes]
        return sorted(everything, key=lambda entry: abs(len(entry[1].vertices) - vertices))[:count]


def read_source(folder: Path | None) -> Source:
    """The meshes of a labelled folder, or generated ones.

    Raises
    ------
    DatasetError, MeshError
        The folder or one of its files cannot be read.
    """
    found: dict[str, list[tuple[str, Mesh]]] = {}
    if folder is None:
        for label in CLASSES:
            found[label] = [(f"{label} {pose}", make_shape(label, pose)) for pose in range(MADE_POSES)]
        return Source(found)
    for path, label in read_collection(folder):
        mesh = read_mesh(path.read_bytes(), format_of(path.name))
        found.setdefault(label.casefold(), []).append((path.name, mesh))
    return Source(found)


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
