"""`isoshape sampling`: its tables, its object, its page and pictures, and files that cannot be used."""

import json
from pathlib import Path

import numpy as np
import pytest

from core.gallery.bodies import make_body
from core.io import write_mesh
from core.studies.sampling import surface as sampling_surface
from core.studies.sampling.surface import METHODS

pytestmark = pytest.mark.studies

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Surfaces of under 1,000 vertices: distances between all pairs are what takes the time."""
    features = sampling_surface.STUDY_PARAMETERS.with_values(mesh={"refine_vertices": 0})
    monkeypatch.setattr(sampling_surface, "STUDY_PARAMETERS", features)


@pytest.fixture
def folder(tmp_path):
    files = tmp_path / "meshes"
    files.mkdir()
    for label, pose in (("person", 2), ("pliers", 0)):
        (files / f"{label} |1|.off").write_bytes(
            write_mesh(make_body(label, vertices=300).posed(pose), "off")
        )
    return files


def test_tables_of_one_file(run, folder):
    done = run("sampling", folder / "person |1|.off")
    assert (done.status, done.stderr) == (0, "")
    for title in ("Fig. 2", "Fig. 3a", "Fig. 3b", "Fig. 3c"):
        assert title in done.stdout
    assert "Poisson disk" in done.stdout
    assert "poses, mean" not in done.stdout


def test_the_object_the_page_and_the_pictures(run, folder, tmp_path):
    poses = [option for pose in sorted(folder.iterdir()) for option in ("--poses", pose)]
    done = run("sampling", folder, *poses, "--out", tmp_path / "new" / "out", "--json")
    assert done.status == 0
    found = json.loads(done.stdout)
    assert [Path(shape["name"]).name for shape in found["shapes"]] == ["person |1|.off", "pliers |1|.off"]
    assert [Path(pose["name"]).name for pose in found["poses"]] == ["person |1|.off", "pliers |1|.off"]
    for shape, pose in zip(found["shapes"], found["poses"], strict=True):
        assert shape["robust_histograms"] == pose["robust_histograms"]
        assert [row["method"] for row in shape["quality"]] == [method.name for method in METHODS]
        for row in shape["steadiness"]:
            assert np.sum(row["histograms"], axis=1) == pytest.approx([1.0, 1.0, 1.0])
    out = tmp_path / "new" / "out"
    page = (out / "sampling.md").read_text()
    pictures = {path.name for path in out.iterdir()} - {"sampling.md"}
    assert pictures == {f"sampling-{name}.png" for name in ("fit", "ratio", "methods", "noise", "poses")}
    for name in pictures:
        assert f"]({name})" in page
        assert (out / name).read_bytes().startswith(PNG)
        assert (out / name).stat().st_size < 300_000
    assert "person \\|1\\|.off" in page
    mean = np.mean([shape["fit_errors"] for shape in found["shapes"]], axis=0)
    assert f"| mean |  | {mean[0]:.4f} | {mean[1]:.4f} | {mean[2]:.4f} |" in page


def test_a_bad_file_costs_the_others_nothing(run, folder):
    (folder / "pliers |1|.off").write_bytes(b"OFF\n1 1 0\n")
    done = run("sampling", folder, "--json")
    assert done.status == 1
    assert "pliers |1|.off" in done.stderr
    assert "1 of 2 files could not be used" in done.stderr
    assert len(json.loads(done.stdout)["shapes"]) == 1


def test_nothing_to_sample(run, folder, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "no meshes found" in run("sampling", tmp_path / "empty").stderr
    (folder / "broken.off").write_bytes(b"")
    done = run("sampling", folder / "broken.off")
    assert done.status == 1
    assert "no file could be used" in done.stderr
    missing = run("sampling", tmp_path / "missing.off")
    assert (missing.status, missing.stdout) == (1, "")
    assert "no such file" in missing.stderr


def test_one_pose_is_refused(run, folder):
    done = run("sampling", "--poses", folder / "person |1|.off")
    assert done.status == 2
    assert "two or more" in done.stderr
