"""Machine code of kernels: the name it is cached under, and that its bits are those of the cache."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import core
from core.kernels.rotation import turn

PROBE = """
import json
import pathlib
import sys

from core.compiled import _kernel_sources, kernel

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
SOURCES = sorted(path.name for path in Path(core.__file__).with_name("kernels").glob("*.py"))


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
    assert {"matching.py", "rotation.py", "reference.py"} < set(SOURCES)
    found = names(copied, [(copied / "kernels" / source, "# Changed.\n") for source in SOURCES])
    assert len(set(found)) == len(found) == len(SOURCES) + 1
    # Another interpreter, another folder: the same sources give the same name.
    assert found[0] == turn.py_func.__qualname__.replace("turn", "probe")


def test_a_source_that_is_added_changes_it_and_another_file_does_not(copied):
    changes = [
        (copied / "mesh.py", "# Changed.\n"),
        (copied / "kernels" / "notes.txt", "Not a source."),
        (copied / "kernels" / "another.py", ""),
        (copied / "kernels" / "one_more.py", "one = 1\n"),
    ]
    before, of_mesh, of_notes, of_another, of_one_more = names(copied, changes)
    assert before == of_mesh == of_notes
    assert of_one_more not in (before, of_another)


def test_how_kernels_are_compiled_changes_it(copied):
    first, second = names(copied, [(copied / "compiled.py", "# Changed.\n")])
    assert first != second


CALLERS = """
import numpy as np

from core.compiled import kernel
from core.kernels.matching import score_pairs
from core.kernels.neighbours import paired
from core.kernels.rotation import EXACT, turn


@kernel
def fitted(x, y, there, back, rotation, scores):
    m, columns, blocks = len(there), x.points.shape[1], len(x.radius)
    partners = np.empty((m, columns), dtype=np.float32)
    sources = np.empty((m, columns), dtype=np.float32)
    for i in range(m):
        partners[i] = y.points[there[i]]
        sources[i] = x.points[back[i]]
    cross = np.empty((columns, columns), dtype=np.float32)
    first = np.empty(blocks, dtype=np.float32)
    second = np.empty(blocks, dtype=np.float32)
    paired(x.points[:m], partners, sources, y.points[:m], blocks, cross, first, second)
    turn(cross, first, second, EXACT, rotation)
    score_pairs(x, y, there, back, partners, sources, rotation, 0.5, scores)


@kernel
def both_ways(x, y, there, back, rotation, scores):
    for way in range(len(scores)):
        if way == 0:
            fitted(x, y, there, back, rotation, scores[way])
        else:
            fitted(y, x, back, there, rotation, scores[way])
"""
CALL = """
import numpy as np
from callers import both_ways

from core.kernels.packed import ONE, Packed

SAMPLES, BLOCKS, DIMENSIONS = 40, 2, 6
COLUMNS = BLOCKS * DIMENSIONS
rng = np.random.default_rng(0)


def cloud():
    numbers = np.arange(SAMPLES + 1, dtype=np.int32)
    return Packed(
        points=rng.normal(size=(SAMPLES, COLUMNS)).astype(np.float32),
        searched=np.zeros((BLOCKS, DIMENSIONS, SAMPLES), dtype=np.float32),
        operators=np.zeros((BLOCKS, 1, SAMPLES, SAMPLES), dtype=np.int16),
        offsets=numbers,
        members=numbers[:-1],
        warp=(ONE * np.stack([np.eye(SAMPLES)] * BLOCKS)).astype(np.int16),
        radius=np.ones(BLOCKS, dtype=np.float32),
        key=np.zeros(4, dtype=np.int32),
    )


there = rng.permutation(SAMPLES).astype(np.int32)
back = np.argsort(there).astype(np.int32)
rotation, scores = np.zeros((COLUMNS, COLUMNS), dtype=np.float32), np.zeros((2, 3))
both_ways(cloud(), cloud(), there, back, rotation, scores)
print(scores.tobytes().hex())
"""


def test_who_compiles_a_kernel_and_who_loads_it_find_the_same_bits(tmp_path):
    """Of callers of callers of the package's own: sums that may be reordered come out otherwise there."""
    (tmp_path / "callers.py").write_text(CALLERS)

    def found():
        done = subprocess.run(
            [sys.executable, "-c", CALL],
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(core.__file__).parents[1])]),
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
            },
            capture_output=True,
            text=True,
            check=True,
            timeout=600,
        )
        return done.stdout

    first = found()
    for name in ("both_ways", "fitted", "score_pairs", "turn"):
        assert list((tmp_path / "cache").rglob(f"*{name}*.nbc"))
    assert found() == first
