"""Other methods over a collection, against the method asked pair by pair."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from core.evaluation.retrieval_measures import evaluate
from core.io import format_of, read_mesh
from service.datasets import read_collection
from service.evaluation.baselines import BASELINES
from tests.service.cli.conftest import Run
from tests.service.cli.evaluation.test_evaluate import KEYS

pytestmark = pytest.mark.studies


@pytest.mark.parametrize("method", BASELINES)
def test_evaluate_by_another_method(collection: Path, method: str, run: Run) -> None:
    done = run("evaluate", collection, "--method", method, "--json")
    assert (done.status, done.stderr) == (0, "")
    report = json.loads(done.stdout)
    assert list(report) == KEYS
    assert report["cc"] == {}
    assert [report[key] for key in ("setting", "rank_by", "shapes", "classes")] == [method, "distance", 9, 3]
    files, baseline = read_collection(collection), BASELINES[method]
    found = [baseline.describe(read_mesh(path.read_bytes(), format_of(path.name))) for path, _ in files]
    distances = np.zeros((9, 9))
    for i in range(9):
        for j in range(i):
            distances[i, j] = distances[j, i] = baseline.compare(found[j], [found[i]])[0]
    expected = evaluate(distances, [label for _, label in files], larger_is_closer=False)
    for name in ("nn", "ft", "st", "e", "dcg", "map"):
        assert report[name] == pytest.approx(getattr(expected, name), abs=1e-9)


def test_bad_files_are_named(collection: Path, tmp_path: Path, run: Run) -> None:
    for path, label in read_collection(collection)[:6]:
        (tmp_path / label).mkdir(exist_ok=True)
        (tmp_path / label / path.name).write_bytes(path.read_bytes())
    (tmp_path / "cup" / "bad.off").write_bytes(b"OFF\n")
    done = run("evaluate", tmp_path, "--method", "shapedna")
    assert "method shapedna: 6 shapes, 2 classes" in " ".join(done.stdout.split())
    assert done.status == 1
    assert [line.split(": ")[:2] for line in done.stderr.splitlines()] == [
        [f"{tmp_path}/cup/bad.off", "malformed-mesh"],
        ["isoshape", "1 of 7 files could not be used"],
    ]


@pytest.mark.parametrize("option", [["--rank-by", "cc"], ["--uncapped"], ["--setting", "paper"]])
def test_other_methods_have_no_settings(tmp_path: Path, run: Run, option: list[str]) -> None:
    done = run("evaluate", tmp_path, "--method", "icp", *option)
    assert done.status == 2
    assert done.stderr == "isoshape: --method icp has no --setting, --rank-by or --uncapped\n"


@pytest.mark.parametrize(("method", "library"), [("shapedna", "lapy"), ("mds", "sklearn")])
def test_a_missing_library_is_named(
    collection: Path, run: Run, monkeypatch: pytest.MonkeyPatch, method: str, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    done = run("evaluate", collection, "--method", method)
    assert done.status == 2
    assert done.stderr.startswith(f"isoshape: {method} needs {library}")
    assert "pip install isoshape[peers]" in done.stderr
