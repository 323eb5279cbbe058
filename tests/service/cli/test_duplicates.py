"""`isoshape duplicates`."""

import csv
import io
from itertools import pairwise
from pathlib import Path
from zipfile import is_zipfile

import pytest

from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.cli.compare import _print_groups
from service.client import Client
from service.duplicates import service
from service.duplicates.schemas import COLUMNS, Duplicate, DuplicatesAnswer
from service.search.local_difference import LocalDifference
from service.shapes.schemas import Shape
from tests.gallery import make_shape
from tests.service.cli.conftest import Run, mesh_bytes
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, part


def test_a_larger_copy_and_another_shape(archive: Client, run: Run, tmp_path: Path) -> None:
    cup = make_shape("cup", 0)
    archive.upload(("a cup.off", mesh_bytes("cup", 0)), tags=["first"])
    archive.upload(("octopus.off", mesh_bytes("octopus", 0)))
    archive.upload(("larger.off", write_mesh(Mesh(2.0 * cup.vertices, cup.faces), "off")))
    alone = run("duplicates", "--csv", "--url", archive.url)
    assert alone.stdout == f"{','.join(COLUMNS)}\n"
    done = run("duplicates", "--scaled", "--url", archive.url)
    assert done.status == 0
    lines = [line.split() for line in done.stdout.splitlines() if line.strip(" ─")]
    heading = " ".join(lines[0])
    assert heading == "group name likeness scale cc of pair residual of pair"
    assert lines[1] == ["1", "a", "cup.off", "same", "1", "1.0000", "0.0000"]
    assert lines[2] == ["1", "larger.off", "scaled", "2", "1.0000", "0.0000"]
    assert len(lines) == 3
    assert "2 of 3 shapes in 1 group;" in done.stderr
    rows = list(
        csv.DictReader(io.StringIO(run("duplicates", "--scaled", "--csv", "--url", archive.url).stdout))
    )
    assert [(row["name"], row["likeness"]) for row in rows] == [
        ("a cup.off", "same"),
        ("larger.off", "scaled"),
    ]
    file = tmp_path / "copies.xlsx"
    assert run("duplicates", "--scaled", "--xlsx", file, "--url", archive.url).status == 0
    assert is_zipfile(file)
    few = run("duplicates", "--scaled", "--tag", "first", "--csv", "--url", archive.url)
    assert few.stdout == alone.stdout


def test_the_hands_of_a_part_and_its_variants(archive: Client, run: Run) -> None:
    bracket = part("bracket", Drawing(6, 0.1))
    meshes = {
        "left": bracket,
        "right": moved(bracket, 1, mirrored=True),
        "hole": part("bracket", Drawing(6, 0.1, change="hole")),
    }
    for name, mesh in meshes.items():
        archive.upload((f"{name}.stl", write_mesh(mesh, "stl")))

    def names(*options: str) -> list[str]:
        table = run("duplicates", *options, "--csv", "--url", archive.url).stdout
        return [row["name"] for row in csv.DictReader(io.StringIO(table))]

    assert names() == ["left.stl", "right.stl"]
    assert names("--no-mirrored") == []
    assert names("--no-mirrored", "--variants") == ["left.stl", "hole.stl"]
    done = run("duplicates", "--variants", "--url", archive.url)
    differs = archive.duplicates(variants=True, mirrored=False).groups[0][1].difference
    assert differs is not None
    assert f"\n1 hole.stl: {differs.text}\n" in done.stdout


def test_the_command_asks_until_all_shapes_are_judged(
    archive: Client, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    cup = make_shape("cup", 0)
    for scale in (1.0, 2.0, 3.0):
        archive.upload((f"{scale}.off", write_mesh(Mesh(scale * cup.vertices, cup.faces), "off")))
    monkeypatch.setattr(service, "JUDGING_SECONDS", 0.001)
    assert archive.duplicates().unjudged
    done = run("duplicates", "--scaled", "--url", archive.url)
    assert "3 of 3 shapes in 1 group;" in done.stderr


def test_the_shape_that_a_variant_is_compared_with_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    shapes = [Shape.model_construct(id=f"id of {name}", name=name) for name in ("first", "second", "third")]
    corner = (0.0, 0.0, 0.0)
    difference = LocalDifference(
        point=corner, low=corner, high=corner, distance=1.0, sides=(corner, corner), area=1.0
    )
    others = [(shapes[0], None, None), *((b, difference, a.id) for a, b in pairwise(shapes))]
    group = [
        Duplicate.model_construct(
            **{"shape": shape, "likeness": "variant", "scale": 1.0, "cc": 1.0, "residual": 0.0},
            **{"difference": differs, "compared_with": other},
        )
        for shape, differs, other in others
    ]
    _print_groups(DuplicatesAnswer.model_construct(groups=[group]))
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2].startswith("1 second: ")
    assert "compared" not in lines[-2]
    assert lines[-1].startswith("1 third: ")
    assert lines[-1].endswith("; compared with second")
