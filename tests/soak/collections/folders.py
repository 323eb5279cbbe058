"""The folders of the collections that ISOSHAPE_DATA names."""

import os
from pathlib import Path

import pytest

from core.io import format_of, read_mesh
from core.mesh.mesh import Mesh


def collections() -> list[Path]:
    """The folders with labels in the one that ISOSHAPE_DATA names; none where it names none."""
    if "ISOSHAPE_DATA" not in os.environ:
        return []
    found = sorted(
        labels.parent for labels in Path(os.environ["ISOSHAPE_DATA"]).resolve().glob("*/labels.csv")
    )
    assert found, "ISOSHAPE_DATA names a folder without collections"
    return found


FOLDERS = collections() or [
    pytest.param(None, marks=pytest.mark.skip(reason="ISOSHAPE_DATA does not name a folder of collections"))
]
every_collection = pytest.mark.parametrize(
    "folder", FOLDERS, ids=lambda folder: folder.name if folder else "none"
)


def read(path: Path) -> Mesh:
    return read_mesh(path.read_bytes(), format_of(path.name))
