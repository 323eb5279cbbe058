"""Scans of a folder: what the archive has after each change of it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.service.engines import on_both
from tests.service.sources.support import Library, put
from tests.service.support import Running, assert_problem, small_file

pytestmark = on_both


@pytest.fixture
def library(running: Running, root: Path) -> Iterator[Library]:
    """A source of three files, of which two are equal."""
    put(root / "a.off", small_file(1))
    put(root / "inner" / "b.off", small_file(2))
    put(root / "inner" / "copy of a.off", small_file(1))
    put(root / "notes.txt", b"no mesh")
    with Library.of(running, root, tags=["found"]) as library:
        yield library


def test_each_change_of_a_folder_is_told_apart(library: Library, root: Path) -> None:
    """Equal files are one shape; a moved file, and a changed one, keep theirs."""
    client, shapes = library.running.client, library.shapes()
    assert set(shapes) == {"a.off", "inner/b.off", "inner/copy of a.off"}
    assert shapes["a.off"] == shapes["inner/copy of a.off"]
    assert library.read()["scan"]["stored"] == 2
    a, b = shapes["a.off"], shapes["inner/b.off"]
    assert client.get(f"/shapes/{a}").json()["tags"] == ["found"]
    assert client.get(f"/shapes/{a}/file").content == small_file(1)

    assert library.rescan()["scan"]["done"] == 0

    assert client.patch(f"/shapes/{b}", json={"tags": ["mine"]}).status_code == 200
    (root / "inner" / "b.off").rename(root / "moved.off")
    assert library.rescan()["scan"]["moved"] == 1
    moved = client.get(f"/shapes/{library.shapes()['moved.off']}").json()
    assert (moved["id"], moved["name"], moved["tags"]) == (b, "moved.off", ["mine"])

    put(root / "moved.off", small_file(3))
    assert library.rescan()["scan"]["changed"] == 1
    assert library.shapes()["moved.off"] == b
    assert client.get(f"/shapes/{b}/file").content == small_file(3)

    # One of two equal files changes: the shape of both stays with the other.
    put(root / "a.off", small_file(4))
    assert library.rescan()["scan"]["stored"] == 1
    assert library.shapes()["inner/copy of a.off"] == a != library.shapes()["a.off"]


def test_a_vanished_file_is_missing_and_comes_back(library: Library, root: Path) -> None:
    shapes = library.shapes()
    (root / "inner" / "b.off").rename(root.parent / "b.off")
    source = library.rescan()
    assert (source["state"], source["counts"]["missing"]) == ("ready", 1)
    assert library.files(state="missing")["inner/b.off"]["missing_since"] is not None
    gone = shapes["inner/b.off"]
    client = library.running.client
    assert client.get(f"/shapes/{gone}").status_code == 200
    assert_problem(client.get(f"/shapes/{gone}/file"), 409, "file-in-place")
    (root.parent / "b.off").rename(root / "again.off")
    assert library.rescan()["counts"] == {"present": 3, "missing": 0, "refused": 0, "unreadable": 0}
    assert library.shapes()["again.off"] == gone


def test_files_that_change_places_take_their_shapes_along(library: Library, root: Path) -> None:
    """As does one that is moved over another, whose shape is then missing."""
    shapes = library.shapes()
    put(root / "c.off", small_file(5))
    library.rescan()
    third = library.shapes()["c.off"]
    (root / "c.off").rename(root / "t")
    (root / "inner" / "b.off").rename(root / "c.off")
    (root / "t").rename(root / "inner" / "b.off")
    assert library.rescan()["scan"]["moved"] == 2
    now = library.shapes()
    assert (now["c.off"], now["inner/b.off"]) == (shapes["inner/b.off"], third)
    (root / "c.off").rename(root / "inner" / "b.off")
    library.rescan()
    files = library.files()
    assert files["inner/b.off"]["shape_id"] == shapes["inner/b.off"]
    assert (files["c.off"]["shape_id"], files["c.off"]["state"]) == (third, "missing")


def test_a_folder_that_lost_too_much_is_offline(library: Library, root: Path) -> None:
    """Absent, empty or more than half gone: nothing is taken for deleted until a person confirms."""
    before = library.shapes()
    root.rename(root.parent / "away")
    assert "cannot be listed" in library.rescan()["detail"]
    root.mkdir()
    source = library.rescan()
    assert (source["state"], source["counts"]["present"]) == ("offline", 3)
    (root.parent / "away" / "a.off").rename(root / "a.off")
    assert library.rescan()["state"] == "ready"
    assert library.shapes()["a.off"] == before["a.off"]
