"""The collections in the folder that ISOSHAPE_DATA names, and the part of each that is tested."""

import os
from pathlib import Path

import numpy as np

from core.io import format_of, read_mesh
from core.mesh.mesh import Mesh
from service.datasets import read_collection

SAMPLE = int(os.environ.get("SAMPLE") or 0)
"""Number of shapes of each collection that are tested, drawn with a seed; 0: all."""


def data() -> Path:
    """Return the folder of collections, without which no test here passes."""
    return Path(os.environ["ISOSHAPE_DATA"]).resolve()


def sample(name: str, count: int = SAMPLE) -> list[tuple[Path, str]]:
    """Return files of a collection with their classes, so many, drawn with a seed; 0: all."""
    files = sorted(read_collection(data() / name))
    return [files[i] for i in np.random.default_rng(2).permutation(len(files))[: count or None]]


def read(path: Path) -> Mesh:
    """Return the mesh of a file."""
    return read_mesh(path.read_bytes(), format_of(path.name))
