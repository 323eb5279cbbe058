"""`isoshape robustness`, against the pipeline asked query by query."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.io import format_of, read_mesh, write_mesh
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.studies.perturbation import add_noise
from core.studies.robustness import KINDS, Perturbation, nearest_neighbour
from service.cli.studies import robustness
from service.datasets import read_collection
from service.studies.robustness.perturbed_queries import seed_of
from service.studies.subset import spread
from tests.core.shapes import icosphere
from tests.service.cli.conftest import Run, mesh_bytes

pytestmark = pytest.mark.studies

PNG = b"\x89PNG\r\n\x1a\n"


FEW = tuple(kind for kind in KINDS if kind.name in {"noise", "cut", "parts"})


@pytest.fixture(autouse=True)
def one_amount(monkeypatch: pytest.MonkeyPatch) -> None:
    """The strongest amount of three kinds, and one tau."""
    study_of(monkeypatch, FEW)


def study_of(monkeypatch: pytest.MonkeyPatch, kinds: Sequence[Perturbation]) -> None:
    """Have the command change shapes in these kinds, by the strongest amount of each."""
    monkeypatch.setattr(
        robustness, "KINDS", tuple(replace(kind, amounts=kind.amounts[-1:]) for kind in kinds)
    )
    monkeypatch.setattr(robustness, "TAUS", (0.2,))


def read(path: Path) -> Mesh:
    return read_mesh(path.read_bytes(), format_of(path.name))


def test_noise_against_a_plain_loop(collection: Path, run: Run) -> None:
    done = run("robustness", collection, "--only", "noise", "--seeds", 2, "--limit", 4, "--json")
    assert (done.status, done.stderr) == (0, "")
    study = json.loads(done.stdout)
    assert [study[key] for key in ("collection", "shapes", "classes", "seeds")] == ["made", 4, 2, 2]
    (level,) = study["levels"]
    assert (level["kind"], level["amount"], level["unusable"]) == ("noise", 0.01, [0, 0])

    pipeline = Pipeline(DEFAULT)
    files = spread(read_collection(collection), 4)
    labels = [label for _, label in files]
    gallery = [pipeline.embed(read(path)) for path, _ in files]
    everywhere = np.ones((4, 4), dtype=bool)

    def retrieval(queries):
        rows = [pipeline.score(query, gallery) for query in queries]
        cc = np.stack([row.cc for row in rows])
        combined = np.stack(
            [pipeline.combined_with(query, gallery, row) for row, query in zip(rows, queries, strict=True)]
        )
        return cc, nearest_neighbour({"cc": cc, "combined": combined}, everywhere, labels)

    assert study["clean"] == pytest.approx(vars(retrieval(gallery)[1]))
    for seed in (0, 1):
        queries = [
            pipeline.embed(add_noise(clean(read(path)).mesh, 0.01, seed_of(path, seed))) for path, _ in files
        ]
        cc, figures = retrieval(queries)
        assert level["runs"][seed] == pytest.approx(vars(figures))
        assert level["own_cc"][seed] == pytest.approx(np.diagonal(cc).mean(), abs=1e-9)


def test_the_page_and_the_pictures(collection: Path, run: Run, tmp_path: Path) -> None:
    assert_page_of(FEW, ["1", "40", "2"], collection, run, tmp_path)


def assert_page_of(
    kinds: Sequence[Perturbation], amounts: list[str], collection: Path, run: Run, tmp_path: Path
) -> None:
    """The page has two pictures and a row for each kind and for tau, whose losses agree with its scores."""
    out = tmp_path / "new" / "out"
    done = run("robustness", collection, "--seeds", 1, "--limit", 4, "--out", out)
    assert (done.status, done.stderr) == (0, "")
    assert "made: 4 shapes, 2 classes, 1 seed(s)" in done.stdout
    page = (out / "robustness.md").read_text()
    assert "`isoshape robustness made --out docs --seeds 1 --limit 4`" in page
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| ")]
    assert [row[0] for row in rows[3:]] == [f"| {kind.title}" for kind in kinds] + ["| sparse ratio tau"]
    assert [row[1].split()[0] for row in rows[3:]] == [*amounts, "0.2"]
    clean_cc, clean_combined = float(rows[2][2]), float(rows[2][4])
    for row, kind in zip(rows[3:], [*kinds, None], strict=True):
        assert bool(row[6].strip()) == bool(row[7].strip()) == (kind is not None and kind.part)
        if kind is not None and kind.part:
            assert float(row[7]) == pytest.approx(100 * (clean_combined - float(row[6])), abs=0.1)
        assert float(row[3]) == pytest.approx(100 * (clean_cc - float(row[2])), abs=0.1)
        assert float(row[5]) == pytest.approx(100 * (clean_combined - float(row[4])), abs=0.1)
    pictures = {path.name for path in out.iterdir()} - {"robustness.md"}
    assert pictures == {"robustness.png", "robustness-shapes.png"}
    for name in pictures:
        assert f"]({name})" in page
        assert (out / name).read_bytes().startswith(PNG)
        assert (out / name).stat().st_size < 300_000


def test_files_and_queries_that_cannot_be_used(run: Run, tmp_path: Path) -> None:
    for label in ("cup", "ball"):
        (tmp_path / label).mkdir()
    (tmp_path / "cup" / "good.off").write_bytes(mesh_bytes("cup", 0))
    (tmp_path / "cup" / "other.off").write_bytes(mesh_bytes("cup", 1))
    (tmp_path / "cup" / "bad.off").write_bytes(b"OFF\n")
    # As large as may be: noise takes it over the limit.
    (tmp_path / "ball" / "huge.off").write_bytes(write_mesh(icosphere(2, radius=1e30), "off"))
    (tmp_path / "ball" / "small.off").write_bytes(write_mesh(icosphere(2), "off"))
    done = run("robustness", tmp_path, "--only", "noise", "--seeds", 1, "--json")
    assert done.status == 1
    lines = done.stderr.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [
        [f"{tmp_path}/cup/bad.off", "malformed-mesh"],
        [f"{tmp_path}/ball/huge.off, Gaussian noise 1 %", "degenerate-mesh"],
        ["isoshape", "1 of 5 files could not be used"],
    ]
    study = json.loads(done.stdout)
    assert study["shapes"] == 4
    assert study["levels"][0]["unusable"] == [1]
    assert study["levels"][0]["runs"][0]["cc"] <= 0.75


def test_wrong_options_are_refused(collection: Path, run: Run, tmp_path: Path) -> None:
    done = run("robustness", collection, "--only", "dust")
    assert (done.status, done.stdout) == (2, "")
    assert "dust is none of noise, holes" in done.stderr
    missing = run("robustness", tmp_path / "nowhere")
    assert (missing.status, missing.stderr) == (1, f"isoshape: {tmp_path}/nowhere: there is no such folder\n")
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "a.off").write_bytes(b"nothing")
    nothing = run("robustness", tmp_path)
    assert nothing.status == 1
    assert nothing.stderr.splitlines()[-1] == "isoshape: no file could be used"
