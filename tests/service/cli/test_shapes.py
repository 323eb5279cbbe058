"""`isoshape list`, `show`, `tag`, `delete` and `restore`."""

import json

import pytest

from core.io import write_mesh
from service.client import Client
from service.client.calls import Upload
from tests.core.shapes import box
from tests.service.cli.conftest import Run, mesh_bytes

LONG = f"{'a long name of a part with a revision ' * 2}.off"


@pytest.fixture
def stored(archive: Client) -> dict[str, Upload]:
    block = (LONG, write_mesh(box(60, 50, 40), "off"))
    return {
        LONG: archive.upload(block, tags=["steel"], metadata={"rev": "b"}),
        "cup.off": archive.upload(("cup.off", mesh_bytes("cup", 0)), tags=["cup", "made"]),
        "cup.stl": archive.upload(("cup.stl", mesh_bytes("cup", 0, "stl")), tags=["cup"]),
    }


def test_list_shows_each_shape_on_one_line(archive: Client, stored: dict[str, Upload], run: Run) -> None:
    done = run("list", "--url", archive.url)
    assert (done.status, done.stderr.splitlines()[-1]) == (0, "3 of 3 shapes")
    (line,) = [line for line in done.stdout.splitlines() if LONG in line]
    for text in ("steel", "off", "60 × 50 × 40", stored[LONG].shape.id):
        assert text in line


def test_list_filters_sorts_and_limits(archive: Client, stored: dict[str, Upload], run: Run) -> None:
    def names(*options: object) -> list[str]:
        done = run("list", "--json", *options, "--url", archive.url)
        return [json.loads(line)["name"] for line in done.stdout.splitlines()]

    assert names() == list(stored)
    assert names("--sort", "newest", "--limit", 2) == ["cup.stl", "cup.off"]
    assert names("--tag", "cup") == ["cup.off", "cup.stl"]
    assert (
        names("--length", "59..61") == names("--metadata", "rev=b") == names("--name", "LONG NAME") == [LONG]
    )
    assert run("list", "--limit", 1, "--url", archive.url).stderr.endswith("1 of 3 shapes\n")


def test_show_describes_a_shape_by_id_or_name(archive: Client, stored: dict[str, Upload], run: Run) -> None:
    shape = stored[LONG].shape
    by_name, by_id = (run("show", text, "--url", archive.url).stdout for text in (LONG, shape.id))
    assert by_name == by_id
    for text in (shape.sha256, "60 × 50 × 40", "14800", "120000", '"rev": "b"', "8 vertices, 12 faces"):
        assert text in by_name
    shown = run("show", "cup.off", "cup.stl", "--json", "--url", archive.url).stdout.splitlines()
    assert [json.loads(line)["id"] for line in shown] == [
        stored[name].shape.id for name in ("cup.off", "cup.stl")
    ]


def test_tags_are_added_and_removed(archive: Client, stored: dict[str, Upload], run: Run) -> None:
    done = run(
        "tag", "cup.off", "cup.stl", "--add", "new", "--add", "cup", "--remove", "made", "--url", archive.url
    )
    assert done.status == 0
    assert [shape.tags for shape in archive.shapes()] == [["steel"], ["cup", "new"], ["cup", "new"]]
    assert run("tag", "cup.off", "--url", archive.url).status == 2
    for option, words in (
        ("--sort", "'size' is not one of 'relevance'"),
        ("--limit", "must be a valid integer"),
    ):
        wrong = run("list", option, "size")
        assert wrong.status == 2
        assert f"Invalid value for '{option}': {words}" in wrong.stderr


def test_shapes_are_tagged_by_a_filter(archive: Client, stored: dict[str, Upload], run: Run) -> None:
    done = run("tag", "--metadata", "rev=b", "--add", "second", "--remove", "steel", "--url", archive.url)
    assert (done.status, done.stderr.splitlines()[-1]) == (0, "1 of 1 shape changed")
    assert {shape.name: shape.tags for shape in archive.shapes()}[LONG] == ["second"]
    both = run("tag", "--tag", "cup,made", "--add", "new", "--url", archive.url)
    assert (both.status, [shape.name for shape in archive.shapes(tag=["new"])]) == (0, ["cup.off"])
    archive.update(stored["cup.stl"].shape.id, tags=["cup", *map(str, range(31))])
    full = run("tag", "--tag", "cup", "--add", "more", "--url", archive.url)
    assert (full.status, "1 of 2 shapes changed" in full.stderr) == (1, True)
    assert f"cup.stl ({stored['cup.stl'].shape.id}): " in full.stderr
    for wrong in (["cup.off", "--tag", "cup"], [], ["--area", "wide"], ["--tag", ","], ["--name", " "]):
        assert run("tag", *wrong, "--add", "x", "--url", archive.url).status == 2
    assert not list(archive.shapes(tag=["x"]))


def test_what_is_deleted_can_be_restored(archive: Client, stored: dict[str, Upload], run: Run) -> None:
    done = run("delete", "cup.off", stored["cup.stl"].shape.id, "--url", archive.url)
    assert f"isoshape restore {stored['cup.off'].shape.id}" in done.stderr
    assert [shape.name for shape in archive.shapes()] == [LONG]
    deleted = run("list", "--deleted", "--url", archive.url).stdout
    assert "cup.off" in deleted
    assert run("restore", stored["cup.off"].shape.id, "--url", archive.url).status == 0
    assert [shape.name for shape in archive.shapes()] == [LONG, "cup.off"]
    assert run("restore", "cup.off", "--url", archive.url).status == 1
    assert run("delete", "cup.off", "--permanent", "--url", archive.url).status == 0
    assert stored["cup.off"].shape.id not in {shape.id for shape in archive.deleted()}


def test_a_command_that_finds_one_name_wrong_changes_nothing(
    archive: Client, stored: dict[str, Upload], run: Run
) -> None:
    done = run("delete", "cup.off", "nothing.off", "--url", archive.url)
    assert done.status == 1
    assert "no shape has the id or the name 'nothing.off'" in done.stderr
    twin = archive.upload(("other.off", mesh_bytes("pliers", 0)), name="cup.off").shape
    done = run("tag", "cup.off", "--add", "new", "--url", archive.url)
    assert done.status == 1
    assert twin.id in done.stderr
    assert stored["cup.off"].shape.id in done.stderr
    assert {shape.id for shape in archive.shapes()} == {twin.id, *(part.shape.id for part in stored.values())}
    assert not list(archive.shapes(tag=["new"]))
