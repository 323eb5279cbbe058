"""`isoshape calibrate`, against the fit to scores asked pair by pair."""

import json
from pathlib import Path

import numpy as np
import pytest

from core.calibration import Collection, fit, leave_class_out, reliability
from core.combination import Calibration
from core.embedding import Embedding
from core.evaluation import evaluate
from core.mesh import Floats
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.reading import format_of, read_mesh
from service.calibration.page import constants
from service.collections import read_collection
from tests.service_cli.conftest import Run, mesh_bytes

PNG = b"\x89PNG\r\n\x1a\n"


def plain(folder: Path) -> Collection:
    """All pairs of a folder, one at a time."""
    pipeline = Pipeline(DEFAULT)
    files = read_collection(folder)
    embeddings = [pipeline.embed(read_mesh(path.read_bytes(), format_of(path.name))) for path, _ in files]

    def evidence(one: Embedding, other: Embedding) -> Floats:
        scores = pipeline.score(one, [other])
        return pipeline.evidence(scores.cc, scores.sim, one.signature, other.signature[None])[0]

    rows = [[evidence(one, other) for other in embeddings] for one in embeddings]
    return Collection(tuple(label for _, label in files), np.array(rows))


@pytest.fixture(scope="module")
def second(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two more classes, one of them the first collection's under another name's case."""
    folder = tmp_path_factory.mktemp("second") / "more"
    for label, name in (("cup", "Cup"), ("fish", "fish")):
        (folder / name).mkdir(parents=True)
        for pose in range(3, 5):
            (folder / name / f"{pose}.off").write_bytes(mesh_bytes(label, pose))
    return folder


def test_the_fit_and_how_it_is_judged(collection: Path, second: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    done = run("calibrate", collection, second, "--json", "--out", out)
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    collections = [plain(collection), plain(second)]
    model = fit(collections)
    assert found["intercept"] == pytest.approx(model.intercept, rel=1e-3)
    assert found["slopes"] == pytest.approx(model.slopes, rel=1e-3)
    chances = leave_class_out(collections)
    for told, one, given, name in zip(
        found["collections"], collections, chances, ("made", "more"), strict=True
    ):
        figures = evaluate(given, one.labels, larger_is_closer=True)
        assert (told["name"], told["shapes"], told["classes"]) == (
            name,
            len(one.labels),
            len(set(one.labels)),
        )
        assert [told[key] for key in ("nn", "ft", "st")] == [figures.nn, figures.ft, figures.st]
        assert told["error"] == pytest.approx(reliability([one], [given]).error, abs=1e-4)
    assert found["together"]["base_rate"] == pytest.approx((9 / 36 + 2 / 6) / 2)

    page = (out / "calibration.md").read_text()
    assert "`isoshape calibrate made more --out docs`" in page
    assert constants(Calibration(found["intercept"], tuple(found["slopes"]))) in page
    assert "](calibration.png)" in page
    assert (out / "calibration.png").read_bytes().startswith(PNG)
    again = run("calibrate", collection, second, "--out", tmp_path / "again")
    assert constants(Calibration(found["intercept"], tuple(found["slopes"]))) in again.stdout
    for name in ("calibration.md", "calibration.png"):
        assert (tmp_path / "again" / name).read_bytes() == (out / name).read_bytes()


def test_the_constants_printed_are_the_code_that_they_stand_for() -> None:
    model = Calibration(-1.25, (-3.5, 0.125))
    names: dict[str, object] = {"Calibration": Calibration}
    exec(constants(model), names)
    assert names["CALIBRATED"] == model


def test_too_few_classes_and_files_that_cannot_be_used(run: Run, tmp_path: Path) -> None:
    for label in ("cup", "pliers"):
        (tmp_path / label).mkdir()
        for pose in range(2):
            (tmp_path / label / f"{pose}.off").write_bytes(mesh_bytes(label, pose))
    few = run("calibrate", tmp_path)
    assert few.status == 1
    assert few.stderr.splitlines()[-1] == (
        "isoshape: three classes or more are needed, two of them with two shapes or more"
    )
    (tmp_path / "octopus").mkdir()
    (tmp_path / "octopus" / "0.off").write_bytes(mesh_bytes("octopus", 0))
    (tmp_path / "octopus" / "bad.off").write_bytes(b"OFF\n")
    done = run("calibrate", tmp_path, "--limit", 9)
    assert done.status == 1
    assert done.stderr.splitlines()[-1] == "isoshape: 1 files could not be used"
    assert "CALIBRATED = Calibration(" in done.stdout
