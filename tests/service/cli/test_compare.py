"""`isoshape compare`: files and ids, scores, arrays and a picture."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.client import Client
from tests.service.cli.conftest import Run, mesh_bytes
from tests.service.support import small_file
from tests.studies.machine_parts import Change, Drawing, part

CHANGES: tuple[Change | None, ...] = (None, "hole")

pytestmark = pytest.mark.usefixtures("few_functions")


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    path = tmp_path / "ball.off"
    path.write_bytes(small_file(1))
    return path


def test_a_file_and_a_stored_shape(archive: Client, ball: Path, run: Run, tmp_path: Path) -> None:
    stored = archive.upload(("stored.off", small_file(1))).shape
    out = tmp_path / "map.npz"
    done = run("compare", ball, stored.id, "--out", out, "--picture", "--url", archive.url)
    assert done.status == 0
    assert done.stdout.strip() == "Same part: cc 1.0000, ssd 0.0000, sim 1.0000, combined 1.0000"
    assert f"wrote {out}" in done.stderr
    assert run("compare", ball, "stored.off", "--url", archive.url).stdout == done.stdout
    missing = run("compare", ball, "no.stl", "--url", archive.url)
    assert (missing.status, "no file or shape has the id or the name 'no.stl'" in missing.stderr) == (1, True)
    count = len(read_mesh(small_file(1), "off").vertices)
    with np.load(out) as arrays:
        assert arrays["vertices"].tolist() == list(range(count))
        assert arrays["confidence"].shape == (count,)
    with Image.open(tmp_path / "map.png") as picture:
        assert picture.size == (1024, 512)


def test_the_size_of_a_copy_is_told(archive: Client, ball: Path, run: Run, tmp_path: Path) -> None:
    mesh = read_mesh(small_file(1), "off")
    (tmp_path / "larger.off").write_bytes(write_mesh(Mesh(1.029 * mesh.vertices, mesh.faces), "off"))
    done = run("compare", ball, tmp_path / "larger.off", "--url", archive.url)
    assert done.stdout.startswith("Same part, 1.029 times as large: cc 1.0000, ")


def test_a_variant_says_what_differs(archive: Client, run: Run, tmp_path: Path) -> None:
    """Everywhere in the words of the service: compared, below the table of results and in the report."""
    paths = [tmp_path / "three.stl", tmp_path / "four.stl"]
    for path, change in zip(paths, CHANGES, strict=True):
        path.write_bytes(write_mesh(part("plate", Drawing(8, 0.1, change=change)), "stl"))
    differs = archive.compare(*paths).difference
    assert differs is not None
    assert differs.text.startswith("4 through holes instead of 3, at (14, ")
    told = f"Variant: {differs.text}"
    assert run("compare", *paths, "--url", archive.url).stdout.replace("\n", " ").startswith(f"{told}: cc ")
    archive.upload(paths[1])
    page = tmp_path / "report.html"
    done = run("query", paths[0], "--html", page, "--url", archive.url)
    assert f"\n1. four.stl: {differs.text}\n" in done.stdout
    assert told in page.read_text(encoding="utf-8")


def test_json_is_the_services_answer(archive: Client, ball: Path, run: Run, tmp_path: Path) -> None:
    other = tmp_path / "cup.off"
    other.write_bytes(mesh_bytes("cup", 0))
    told = json.loads(run("compare", ball, other, "--json", "--url", archive.url).stdout)
    direct = archive.compare(ball, other)
    assert told["cc"] == direct.cc
    assert "vertices" not in told
    assert archive.page().total == 0


def test_a_picture_needs_a_place(ball: Path, run: Run) -> None:
    done = run("compare", ball, ball, "--picture")
    assert done.status == 2
    assert "--out" in done.stderr


def test_an_unknown_id_is_told(archive: Client, ball: Path, run: Run) -> None:
    done = run("compare", ball, "no-such-shape", "--url", archive.url)
    assert done.status == 1
    assert "no-such-shape" in done.stderr


def test_landmarks_are_printed_as_csv(archive: Client, ball: Path, run: Run, tmp_path: Path) -> None:
    points = read_mesh(small_file(1), "off").vertices[[3, 50, 90]]
    marks = tmp_path / "marks.csv"
    rows = [
        f"{name},{x},{y},{z}" for name, (x, y, z) in zip(("nose", "=tail", '"a, b"'), points, strict=True)
    ]
    marks.write_text("\n".join(["name,x,y,z", *rows]))
    done = run("compare", ball, ball, "--landmarks", marks, "--url", archive.url)
    assert done.status == 0
    head, *found = csv.reader(done.stdout.splitlines())
    assert head == ["name", "x", "y", "z", "confidence"]
    assert [row[0] for row in found] == ["nose", "'=tail", "a, b"]
    np.testing.assert_allclose([[float(cell) for cell in row[1:4]] for row in found], points, atol=1e-6)
    assert "Same part" in done.stderr


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("name,x,y\na,1,2\n", "no column 'z'"),
        ("name;x;y;z\na;1;2;3\n", "separated by commas"),
        ("name,x,y,z\na,1,2,\n", "line 2"),
        ("name,x,y,z,x2,y2,z2\na,1,2,3,4,5,\n", "line 2"),
        ("name,x,y,z\n", "no landmarks"),
    ],
)
def test_a_file_that_has_no_landmarks(ball: Path, run: Run, tmp_path: Path, text: str, told: str) -> None:
    marks = tmp_path / "marks.csv"
    marks.write_text(text)
    done = run("compare", ball, ball, "--landmarks", marks)
    assert done.status == 2
    assert told in done.stderr.replace("\n", " ")
