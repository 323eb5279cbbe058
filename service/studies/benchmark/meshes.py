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
"""Made classes that stand for those of the Princeton Segmentation Benchmark under another name."""

NEAR = 0.15
"""A number of vertices may be off by this part."""


@dataclass(frozen=True)
class Source:
    """Meshes by class, each with its name; classes in lower case."""

    classes: Mapping[str, list[tuple[str, Mesh]]]

    def of(self, label: str) -> list[tuple[str, Mesh]]:
        """The meshes of a class, or of the made class that stands for it; empty if there is none."""
        return self.classes.get(label) or self.classes.get(MADE.get(label, label), [])

    def nearest(self, vertices: int, count: int) -> list[tuple[str, Mesh]]:
        """The meshes whose number of vertices is nearest."""
        everything = [entry for meshes in self.classes.values() for entry in meshes]
        return sorted(everything, key=lambda entry: abs(len(entry[1].vertices) - vertices))[:count]


def read_source(folder: Path | None) -> Source:
    """The meshes of a labelled folder, or made ones.

    Raises
    ------
    DatasetError, MeshError
        The folder, or a file in it, cannot be used.
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
    """The surface with about so many vertices: all edges halved until there are enough, then simplified."""
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
