"""`isoshape duplicates`."""

import csv
import io

import pytest

from core.gallery import make_shape
from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.client import Client
from service.duplicates import service
from tests.service.cli.conftest import Run, mesh_bytes


def test_a_larger_copy_and_another_shape(archive: Client, run: Run) -> None:
    cup = make_shape("cup", 0)
    archive.upload(("a cup.off", mesh_bytes("cup", 0)), tags=["first"])
    archive.upload(("octopus.off", mesh_bytes("octopus", 0)))
    archive.upload(("larger.off", write_mesh(Mesh(2.0 * cup.vertices, cup.faces), "off")))
    done = run("duplicates", "--url", archive.url)
    assert done.status == 0
    lines = [line.split() for line in done.stdout.splitlines() if line.strip(" ─")]
    assert lines[0] == ["group", "name", "likeness", "scale", "cc", "residual"]
    assert lines[1] == ["1", "a", "cup.off", "same", "1", "1.0000", "0.0000"]
    assert lines[2] == ["1", "larger.off", "scaled", "2", "1.0000", "0.0000"]
    assert len(lines) == 3
    assert "2 of 3 shapes in 1 groups" in done.stderr
    rows = list(csv.DictReader(io.StringIO(run("duplicates", "--csv", "--url", archive.url).stdout)))
    assert [(row["name"], row["likeness"]) for row in rows] == [
        ("a cup.off", "same"),
        ("larger.off", "scaled"),
    ]
    few = run("duplicates", "--tag", "first", "--csv", "--url", archive.url)
    assert few.stdout == "group,id,name,likeness,scale,cc,residual\n"


def test_the_command_asks_until_all_shapes_are_judged(
    archive: Client, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    cup = make_shape("cup", 0)
    for scale in (1.0, 2.0, 3.0):
        archive.upload((f"{scale}.off", write_mesh(Mesh(scale * cup.vertices, cup.faces), "off")))
    monkeypatch.setattr(service, "JUDGING_SECONDS", 0.001)
    assert archive.duplicates().unjudged
    done = run("duplicates", "--url", archive.url)
    assert "3 of 3 shapes in 1 groups" in done.stderr
