"""Machine code of kernels: the name it is cached under, and that its bits are those of the cache."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import core
from core.gallery import make_shape
from core.matching.kernels.orthogonal_procrustes import fit_rotation
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.serialization import embedding_to_bytes

PROBE = """
import json
import pathlib
import sys

from core.numerics.compilation import _kernel_sources, kernel

def name():
    def probe():
        return 0

    _kernel_sources.cache_clear()
    return kernel(probe).py_func.__qualname__

names = [name()]
for path, text in json.loads(sys.argv[1]):
    with pathlib.Path(path).open("a") as file:
        file.write(text)
    names.append(name())
print(json.dumps(names))
"""
SOURCES = sorted(path.name for path in (Path(core.__file__).parent / "matching" / "kernels").glob("*.py"))


@pytest.fixture
def copied(tmp_path):
    ignored = shutil.ignore_patterns("__pycache__")
    return Path(shutil.copytree(Path(core.__file__).parent, tmp_path / "core", ignore=ignored))


def names(copied, changes):
    """A kernel's name before any of the changes and after each, by an interpreter that reads the copy."""
    probe = copied.parent / "probe.py"
    probe.write_text(PROBE)
    done = subprocess.run(
        [sys.executable, "-B", str(probe), json.dumps([(str(path), text) for path, text in changes])],
        cwd=copied.parent,
        env={**os.environ, "PYTHONPATH": str(copied.parent)},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return json.loads(done.stdout)


def test_a_change_of_any_source_of_the_package_changes_the_name(copied):
    assert {"pair_matching.py", "orthogonal_procrustes.py", "spline_search.py"} < set(SOURCES)
    found = names(copied, [(copied / "matching" / "kernels" / source, "# Changed.\n") for source in SOURCES])
    assert len(set(found)) == len(found) == len(SOURCES) + 1
    # Another interpreter, another folder: the same sources give the same name.
    assert found[0] == fit_rotation.py_func.__qualname__.replace("fit_rotation", "probe")


def test_a_source_that_is_added_changes_it_and_another_file_does_not(copied):
    changes = [
        (copied / "mesh" / "mesh.py", "# Changed.\n"),
        (copied / "matching" / "kernels" / "notes.txt", "Not a source."),
        (copied / "matching" / "kernels" / "another.py", ""),
        (copied / "matching" / "kernels" / "one_more.py", "one = 1\n"),
    ]
    before, of_mesh, of_notes, of_another, of_one_more = names(copied, changes)
    assert before == of_mesh == of_notes
    assert of_one_more not in (before, of_another)


def test_how_kernels_are_compiled_changes_it(copied):
    first, second = names(copied, [(copied / "numerics" / "compilation.py", "# Changed.\n")])
    assert first != second


MATCH = """
import sys
from pathlib import Path

import numpy as np

from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.serialization import embedding_from_bytes

shapes = [embedding_from_bytes(Path(path).read_bytes()) for path in sys.argv[1:]]
scores = [Pipeline(DEFAULT).score(shape, shapes) for shape in shapes]
print(np.array([[row.cc, row.ssd, row.sim] for row in scores]).tobytes().hex())
"""


def test_who_compiles_a_kernel_and_who_loads_it_find_the_same_bits(tmp_path):
    pipeline = Pipeline(DEFAULT)
    paths = []
    for name in ("pliers", "hand", "person"):
        paths.append(tmp_path / name)
        paths[-1].write_bytes(embedding_to_bytes(pipeline.embed(make_shape(name, 0))))

    def found():
        done = subprocess.run(
            [sys.executable, "-c", MATCH, *map(str, paths)],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            capture_output=True,
            text=True,
            check=True,
            timeout=600,
        )
        return done.stdout

    first = found()
    assert list((tmp_path / "cache").rglob("*match_pair*.nbc"))
    assert found() == first
