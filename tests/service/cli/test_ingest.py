"""`isoshape ingest` into a running service."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.cli.ingest import class_tag
from service.client import Client
from tests.core.io.step_files import step_box, step_machine
from tests.service.cli.conftest import CLASSES, POSES, Run, mesh_bytes
from tests.service.jobs.support import pack
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, part


@pytest.fixture(autouse=True)
def at_the_service(archive: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ISOSHAPE_URL", archive.url)


def test_a_folder_of_class_folders_twice(archive: Client, collection: Path, run: Run) -> None:
    total = len(CLASSES) * POSES
    first = run("ingest", collection, "--tag", "made")
    assert (first.status, first.stdout) == (0, f"{total} stored, 0 already there, 0 refused\n")
    assert first.stderr == f"using the service at {archive.url}\n"
    stored = {shape.name: shape.tags for shape in archive.shapes()}
    assert stored == {path.name: [path.parent.name, "made"] for path in collection.glob("*/*")}
    again = run("ingest", collection)
    assert (again.status, again.stdout) == (0, f"0 stored, {total} already there, 0 refused\n")
    tagged = run("ingest", collection, "--tag", "new")
    assert (
        tagged.stdout == f"0 stored, {total} already there ({total} with new tags or metadata), 0 refused\n"
    )
    assert {shape.name: shape.tags for shape in archive.shapes()} == {
        name: [*tags, "new"] for name, tags in stored.items()
    }
    assert archive.page().total == total


def test_bad_files_are_listed_and_the_rest_is_stored(archive: Client, tmp_path: Path, run: Run) -> None:
    good = mesh_bytes("cup", 0)
    files = {"good.off": good, "cut.off": good[: len(good) // 2], "empty.stl": b"", "words.ply": b"hello"}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    rows = "".join(f"{name},Cup\n" for name in (*files, "missing.off"))
    (tmp_path / "labels.csv").write_text("file,class\n" + rows, encoding="utf-8")
    done = run("ingest", tmp_path)
    assert done.status == 1
    assert done.stdout == "1 stored, 0 already there, 4 refused\n"
    causes = dict(line.split(": ", 1) for line in done.stderr.splitlines()[1:])
    assert list(causes) == [
        str(tmp_path / name) for name in ("cut.off", "empty.stl", "missing.off", "words.ply")
    ]
    assert [cause.split(":")[0] for cause in causes.values()] == [
        "malformed-mesh",
        "empty-file",
        "No such file or directory",
        "malformed-mesh",
    ]
    assert [(shape.name, shape.tags) for shape in archive.shapes()] == [("good.off", ["Cup"])]


def test_a_dry_run_tells_what_is_there_already(archive: Client, tmp_path: Path, run: Run) -> None:
    mesh = read_mesh(mesh_bytes("cup", 0), "off")
    archive.upload(("stored cup.off", mesh_bytes("cup", 0)))
    plates = {change: part("plate", Drawing(8, 0.1, change=change)) for change in (None, "hole")}
    archive.upload(("plate.stl", write_mesh(plates[None], "stl")))
    meshes = {
        "again.off": Mesh(mesh.vertices[:, [1, 2, 0]] + 1.0, mesh.faces),
        "large.off": Mesh(2.0 * mesh.vertices, mesh.faces),
        "larger.off": Mesh(1.029 * mesh.vertices, mesh.faces),
        "other.off": read_mesh(mesh_bytes("octopus", 0), "off"),
        "variant.stl": moved(plates["hole"], 1),
    }
    files = {name: write_mesh(each, Path(name).suffix[1:]) for name, each in meshes.items()}
    files |= {name: mesh_bytes("cup", 0) for name in ("renamed.off", "stored cup.off")}
    files |= {"twice/other.off": files["other.off"], "bad.off": b"OFF"}
    (tmp_path / "twice").mkdir()
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "labels.csv").write_text(
        "file,class\n" + "".join(f"{name},x\n" for name in (*files, "gone.off"))
    )
    done = run("ingest", tmp_path, "--dry-run")
    lines = [line.removeprefix(f"{tmp_path}/") for line in done.stdout.splitlines()]
    assert lines[:8] == [
        "again.off: would be stored; Same part: stored cup.off",
        "large.off: would be stored; Same part, 0.5 times as large: stored cup.off",
        "larger.off: would be stored; Same part, 0.9718 times as large: stored cup.off",
        "other.off: would be stored",
        "variant.stl: would be stored; Variant: plate.stl",
        "renamed.off: would be stored; Same part: stored cup.off",
        "stored cup.off: already there",
        "twice/other.off: already there",
    ]
    assert lines[8].startswith("bad.off: refused; ")
    counts = "6 would be stored, 2 already there, 2 refused"
    assert lines[9:] == ["gone.off: refused; No such file or directory", counts]
    assert (done.status, archive.page().total) == (1, 2)
    assert run("ingest", tmp_path).stdout.startswith("6 stored, 2 already there (")
    (tmp_path / "a.zip").write_bytes(pack({"a.off": b"OFF"}))
    assert run("ingest", tmp_path / "a.zip", "--dry-run").status == 2


@pytest.mark.parametrize("name", ['1".off', "a\\b.off", "\t.off", " a .off", "e\u0301.off"])
def test_a_dry_run_knows_files_of_odd_names(tmp_path: Path, run: Run, name: str) -> None:
    (tmp_path / name).write_bytes(mesh_bytes("cup", 0))
    assert run("ingest", tmp_path).stdout == "1 stored, 0 already there, 0 refused\n"
    again = run("ingest", tmp_path, "--dry-run").stdout
    assert again.endswith("\n0 would be stored, 1 already there, 0 refused\n")


def test_a_name_that_is_not_utf_8_is_refused(archive: Client, tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"R\xe4der")
    folder.mkdir()
    for name in ("good.off", os.fsdecode(b"\xe4.off")):
        (folder / name).write_bytes(mesh_bytes("cup", 0))
    command = [sys.executable, "-m", "service.cli", "ingest", str(tmp_path)]
    for option, outcome in (
        ([], b"1 stored, 0 already there, 1 refused"),
        (["--dry-run"], b"0 would be stored, 1 already there, 1 refused"),
    ):
        done = subprocess.run([*command, *option], check=False, capture_output=True)
        assert (done.returncode, done.stdout.splitlines()[-1]) == (1, outcome)
        assert b"\\udce4.off: " in done.stdout + done.stderr
        assert b"the name is not UTF-8" in done.stdout + done.stderr
    assert [(shape.name, shape.tags) for shape in archive.shapes()] == [("good.off", ["R?der"])]


def test_a_single_file_and_files_of_other_formats(archive: Client, tmp_path: Path, run: Run) -> None:
    (tmp_path / "one.off").write_bytes(mesh_bytes("cup", 0))
    (tmp_path / "notes.txt").write_text("x", encoding="utf-8")
    done = run("ingest", tmp_path)
    assert (done.status, done.stdout) == (
        0,
        "1 stored, 0 already there, 0 refused, 1 of other formats left out\n",
    )
    assert run("ingest", tmp_path / "one.off").stdout == "0 stored, 1 already there, 0 refused\n"
    named = run("ingest", tmp_path / "notes.txt")
    assert named.status == 1
    assert "unknown-format" in named.stderr
    assert archive.page().total == 1


def test_a_single_file_of_a_labelled_folder(archive: Client, tmp_path: Path, run: Run) -> None:
    for name in ("one.off", "two.off"):
        (tmp_path / name).write_bytes(mesh_bytes("cup", 0))
    (tmp_path / "labels.csv").write_text("file,class\none.off,Cup\n", encoding="utf-8")
    assert run("ingest", tmp_path / "one.off", tmp_path / "two.off").status == 0
    assert {shape.name: shape.tags for shape in archive.shapes()} == {"one.off": ["Cup"], "two.off": []}


def test_an_archive_is_stored_by_a_job(archive: Client, tmp_path: Path, run: Run) -> None:
    good = {f"{label}.off": mesh_bytes(label, 0) for label in CLASSES}
    path = tmp_path / "meshes.zip"
    path.write_bytes(pack({**good, "bad/cut.off": good["cup.off"][:500]}))
    done = run("ingest", path, "--tag", "made")
    assert (done.status, done.stdout) == (1, "3 stored, 0 already there, 1 refused\n")
    assert done.stderr.splitlines()[1].startswith(f"{path}: bad/cut.off: malformed-mesh: ")
    assert {shape.name: shape.tags for shape in archive.shapes()} == {name: ["made"] for name in good}
    beside = {"README.md": b"# Cups", "images/cup.png": b"x", "__MACOSX/._cup.off": good["cup.off"]}
    path.write_bytes(pack({**good, **beside}))
    done = run("ingest", path)
    left_out = "0 stored, 3 already there, 0 refused, 3 of other formats left out\n"
    assert (done.status, done.stdout) == (0, left_out)


def test_a_file_with_the_name_of_an_archive_that_is_none(archive: Client, tmp_path: Path, run: Run) -> None:
    (tmp_path / "words.zip").write_text("hello", encoding="utf-8")
    (tmp_path / "half.zip").write_bytes(pack({"a.off": mesh_bytes("cup", 0)})[:900])
    done = run("ingest", tmp_path / "words.zip", tmp_path / "half.zip")
    assert done.status == 1
    half, words = done.stderr.splitlines()[1:]
    assert half.startswith(f"{tmp_path / 'half.zip'}: malformed-archive: ")
    assert words.startswith(f"{tmp_path / 'words.zip'}: unknown-archive: ")


def test_nothing_to_store(tmp_path: Path, run: Run) -> None:
    done = run("ingest", tmp_path)
    assert done.status == 1
    assert done.stderr.startswith("isoshape: no meshes found")
    assert run("ingest", tmp_path / "nowhere").status == 1


def test_a_service_that_is_away(collection: Path, run: Run) -> None:
    done = run("ingest", collection, "--url", "http://127.0.0.1:9")
    assert done.status == 1
    assert len(done.stderr.splitlines()) == 1
    assert "no answer from http://127.0.0.1:9" in done.stderr


@pytest.mark.parametrize(
    ("label", "tag"),
    [("Human", "Human"), ("a, b,c", "a b c"), (" ,x ", "x"), (",", ""), ("y" * 80, "y" * 64)],
)
def test_a_class_becomes_a_tag_that_the_service_takes(label: str, tag: str) -> None:
    assert class_tag(label) == tag


def test_assemblies_are_split(archive: Client, tmp_path: Path, run: Run) -> None:
    folder = tmp_path / "bought"
    folder.mkdir()
    (folder / "machine.step").write_bytes(step_machine())
    (folder / "box.stp").write_bytes(step_box((3, 4, 5)))
    table = tmp_path / "parts.csv"
    table.write_text("name,supplier\nmachine.step,ACME\n", encoding="utf-8")
    done = run("ingest", folder, "--split", "parts", "--tag", "made", "--metadata", table)
    assert (done.status, done.stdout) == (0, "6 stored, 0 already there, 0 refused\n")
    stored = {(shape.name, shape.metadata.get("assembly_path")): shape for shape in archive.shapes()}
    own = {"supplier": "ACME", "assembly": "machine.step"}
    assert {key: shape.metadata for key, shape in stored.items()} == {
        ("box.stp", None): {},
        ("machine.step", None): {"supplier": "ACME"},
        **{
            (f"machine.step/{name}", path): {**own, "assembly_path": path, "instances": instances}
            for name, path, instances in [
                ("ring", "machine/use 3/use 0", 2),
                ("pin", "machine/use 3/use 1", 5),
                ("plate", "machine/use 6", 1),
                ("plate", "machine/use 7", 1),
            ]
        },
    }
    assert all("made" in shape.tags for shape in stored.values())
    again = run("ingest", folder, "--split", "parts", "--metadata", table)
    assert again.stdout == "0 stored, 6 already there, 0 refused\n"
    assert run("ingest", folder).stdout == "0 stored, 2 already there, 0 refused\n"


def test_an_archive_is_not_split(archive: Client, tmp_path: Path, run: Run) -> None:
    path = tmp_path / "meshes.zip"
    path.write_bytes(pack({"machine.step": step_machine()}))
    done = run("ingest", path, "--split", "parts")
    assert (done.status, done.stdout) == (1, "")
    assert "unpack it first" in done.stderr
    assert archive.page().total == 0


def test_metadata_of_a_spreadsheet(archive: Client, collection: Path, tmp_path: Path, run: Run) -> None:
    table = tmp_path / "parts.csv"
    rows = [
        "name,tags,material,number",
        'cup-0.off,"drink; kitchen,old",clay,007',
        "pliers/pliers-0.off,,steel,",
        "nothing.off,,wood,1",
    ]
    table.write_text("\ufeff" + "\r\n".join(rows), encoding="utf-8")
    done = run("ingest", collection, "--metadata", table, "--tag", "made")
    assert done.status == 0
    assert done.stderr.splitlines()[0] == f"{table}: no file has the name nothing.off"
    stored = {shape.name: (shape.tags, shape.metadata) for shape in archive.shapes()}
    assert stored["cup-0.off"] == (
        ["cup", "drink", "kitchen", "old", "made"],
        {"material": "clay", "number": "007"},
    )
    assert stored["pliers-0.off"] == (["pliers", "made"], {"material": "steel"})
    assert stored["octopus-0.off"] == (["octopus", "made"], {})
    assert [shape.name for shape in archive.shapes(metadata=["number=007"])] == ["cup-0.off"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("file,material\na.off,clay\n", "the columns, name among them"),
        ("", "the columns, name among them"),
        ("name,material,material\n", "a column has no name, or the name of another"),
        ("name,\na.off,clay\n", "a column has no name, or the name of another"),
        ("name,material\na.off,clay\na.off,clay\n", "line 3: a.off is listed twice"),
        ("name,material\n,clay\n", "line 2: no name"),
        ("name,material\na.off\n", "line 2: not as many cells as there are columns"),
        ("name,material\na.off,clay,more\n", "line 2: not as many cells as there are columns"),
        (f"name,tags\na.off,{'t' * 65}\n", "line 2: tags: a tag must have 1 to 64 characters"),
        ('name,material\n"a.off,clay\n', "unexpected end of data"),
    ],
)
def test_metadata_that_cannot_be_used(
    archive: Client, collection: Path, tmp_path: Path, run: Run, text: str, said: str
) -> None:
    table = tmp_path / "parts.csv"
    table.write_text(text, encoding="utf-8")
    done = run("ingest", collection, "--metadata", table)
    assert done.status == 1
    assert said in done.stderr
    assert archive.page().total == 0
