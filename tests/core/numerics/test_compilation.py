"""Machine code of kernels: the name it is cached under, and that its bits are those of the cache."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import core
from core.matching.kernels.procrustes import fit_rotations

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
    assert {"pair_matching.py", "procrustes.py", "spline_search.py"} < set(SOURCES)
    found = names(copied, [(copied / "matching" / "kernels" / source, "# Changed.\n") for source in SOURCES])
    assert len(set(found)) == len(found) == len(SOURCES) + 1
    # Another interpreter, another folder: the same sources give the same name.
    assert found[0] == fit_rotations.py_func.__qualname__.replace("fit_rotations", "probe")


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


def test_compiler_options_change_the_key(copied):
    first, second = names(copied, [(copied / "numerics" / "compilation.py", "# Changed.\n")])
    assert first != second


NEAREST = """
import numpy as np

from core.matching.kernels.nearest_neighbours import nearest_both_ways

drawn = np.random.default_rng(0)
points, targets = (drawn.normal(size=size).astype(np.float32) for size in ((40, 8), (8, 48)))
there, back = np.empty(40, dtype=np.int32), np.empty(48, dtype=np.int32)
nearest_both_ways(points, targets, 64, there, back)
print(there.tolist(), back.tolist())
"""


def assert_compiled_and_loaded_alike(program, folder, kernel, *arguments):
    """A process that compiles a kernel prints the same as one that loads it from the cache."""

    def printed():
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
        command = [sys.executable, "-c", program, *map(str, arguments)]
        return subprocess.check_output(command, env=environment, timeout=600)

    first = printed()
    assert list((folder / "cache").rglob(f"*{kernel}*.nbc"))
    assert first
    assert printed() == first


def test_a_compiled_and_a_loaded_kernel_have_the_same_bits(tmp_path):
    assert_compiled_and_loaded_alike(NEAREST, tmp_path, "nearest_both_ways")
