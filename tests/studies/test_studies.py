"""Scripts that have no bounds to check run once at their least size, and write their tables."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest

from core.gallery import make_shape
from core.io import write_mesh
from tests.studies.report import markdown

pytestmark = pytest.mark.studies

SCRIPTS = {
    "robustness": (("--seeds", "1", "--only", "holes", "tau", "--workers", "1"), {"robustness": 11}),
    "figures": (("--shown", "cup", "--workers", "1"), {}),
    "sampling": (("--limit", "2"), {"fit": 2, "samples": 8, "poses": 8}),
    "individuals": (("--bodies", "1", "--poses", "2"), {"labels": 4}),
    "partial": (("--limit", "4", "--cut", "0.3"), {"partial": 3}),
    "peers": (("--vertices", "600", "--repeats", "1"), {"embeddings": 5, "matches": 3}),
    "mirrored": (("--limit", "1", "--bodies", "1", "--vertices", "900"), {"mirrored": 2}),
    "words": (("--names", "200", "--times", "200"), {"words": 2}),
    "decisions": (("--groups", "4"), {"decisions": 7}),
    "suggestions": (("--count", "40"), {"suggestions": 5}),
    "capacity": (
        ("--count", "20000", "--rows", "20000"),
        {"bytes": 6, "storing": 2, "search": 2, "graph": 1, "vectors": 16},
    ),
}
"""The options of each script, and the number of rows of each table."""

OF_COLLECTIONS = {"robustness", "partial"}


@pytest.fixture(scope="module")
def collection(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("collections") / "made"
    for label in ("cup", "octopus", "pliers"):
        (folder / label).mkdir(parents=True)
        for pose in range(2):
            (folder / label / f"{pose}.off").write_bytes(write_mesh(make_shape(label, pose), "off"))
    return folder


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_writes_its_tables_and_pictures(name: str, collection: Path, tmp_path: Path) -> None:
    options, tables = SCRIPTS[name]
    if name in OF_COLLECTIONS:
        options = (str(collection), *options)
    elif name in {"figures", "peers"}:
        options = ("--collection", str(collection), *options)
    command = [sys.executable, "-m", f"tests.studies.{name}", str(tmp_path), *options]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for table, count in tables.items():
        with (tmp_path / f"{table}.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == count
        assert markdown(tmp_path / f"{table}.csv").count("\n") == count + 1
    pictures = list(tmp_path.glob("*.png"))
    assert len(pictures) == {"figures": 6, "robustness": 2, "sampling": 2, "suggestions": 1}.get(name, 0)
    assert all(path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") for path in pictures)
