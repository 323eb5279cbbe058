"""Scans of a folder: what the archive has after each change of it."""

import asyncio
import os
import threading
from collections.abc import Iterator, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from service.shapes.service import ingest
from service.sources import reading, repository, scanner, storing
from service.sources.scanner import Scanner
from service.sources.service import forget_removed
from service.storage.database import WriteSession, erase
from service.storage.in_place import open_beneath
from service.storage.tables import ShapeRow, SourceRow
from tests.service.engines import on_both
from tests.service.sources.support import Library, put
from tests.service.support import (
    Running,
    assert_problem,
    serving,
    settings_in,
    small_file,
    wait_until,
    working_in,
)

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


def test_rules_tag_new_shapes_by_their_paths(running: Running, root: Path) -> None:
    put(root / "brackets" / "a v2.off", small_file(11))
    put(root / "b.off", small_file(12))
    rules = {"brackets/": ["bracket", "metal"], "*v[0-9].off": ["draft", "metal"], "/a*": ["never"]}
    with Library.of(running, root, tags=["found"], rules=rules) as library:
        assert library.read()["rules"] == rules
        tags = {
            path: running.client.get(f"/shapes/{shape}").json()["tags"]
            for path, shape in library.shapes().items()
        }
        assert tags == {"b.off": ["found"], "brackets/a v2.off": ["found", "bracket", "metal", "draft"]}


def test_rules_that_change_tag_stored_shapes_too(running: Running, root: Path) -> None:
    """And a file that the rules gave too many tags is read again."""
    put(root / "a.off", small_file(11))
    put(root / "b.off", small_file(12))
    many = {f"{letter}*": [f"{letter}{i}" for i in range(31)] for letter in "ab"}
    with Library.of(running, root, tags=["found"], rules={**many, "b.off": ["one more"]}) as library:
        assert library.read()["counts"]["refused"] == 1
        assert "at most 32 tags" in library.files()["b.off"]["problem"]["detail"]
        rules = {"*.off": ["x"], "a*": ["a0", "y"], "b*": ["b"]}
        changed = running.client.put(f"/sources/{library.id}/rules", json={"rules": rules})
        assert (changed.json()["rules"], changed.json()["state"]) == (rules, "waiting")
        assert library.wait()["counts"]["present"] == 2
        shapes = library.shapes()
        tags = {path: running.client.get(f"/shapes/{shape}").json()["tags"] for path, shape in shapes.items()}
        # One has no room for two more tags.
        assert tags == {"a.off": ["found", *many["a*"]], "b.off": ["found", "x", "b"]}
        running.client.put(f"/sources/{library.id}/rules", json={"rules": {"*.off": ["z"]}})
        library.wait()
        assert running.client.get("/shapes", params={"tag": "z"}).json()["total"] == 1
        assert running.client.patch(f"/shapes/{shapes['b.off']}", json={"tags": []}).status_code == 200
        library.rescan()
        assert running.client.get(f"/shapes/{shapes['b.off']}").json()["tags"] == []


def test_wrong_rules_are_refused(running: Running, root: Path) -> None:
    for pattern in ("!", "!a", "# a", "/"):
        wrong = running.client.post("/sources", json={"path": str(root), "rules": {pattern: ["a"]}})
        assert_problem(wrong, 422, "bad-request-fields")


def test_a_shape_that_is_restored_outlives_its_source(running: Running, root: Path) -> None:
    put(root / "a.off", small_file(1))
    with Library.of(running, root) as library:
        shape = library.shapes()["a.off"]
    assert running.client.post(f"/shapes/{shape}/restore").status_code == 200
    (root / "a.off").unlink()
    for keep in (timedelta(days=7), timedelta(0)):
        forget_removed(running.container.database, keep)
        assert running.client.get(f"/shapes/{shape}/file").content == small_file(1)


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


def test_an_unexpected_error_does_not_end_the_scanner(
    running: Running, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted, failed = Scanner._wanted, threading.Event()

    def fail_once(self: Scanner, sources: Sequence[SourceRow]) -> list[SourceRow]:
        if not failed.is_set():
            failed.set()
            raise PermissionError
        return wanted(self, sources)

    monkeypatch.setattr(Scanner, "_wanted", fail_once)
    monkeypatch.setattr(scanner, "PAUSE_SECONDS", 0.0)
    with Library.of(running, root) as library:
        assert failed.is_set()
        assert library.read()["state"] == "ready"


def test_a_service_notices_a_new_file_soon_and_a_folder_that_goes_and_comes(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = 4.0

    async def slowly(*arguments: Any, **named: Any) -> Any:
        await asyncio.sleep(stored)
        return await ingest(*arguments, **named)

    put(root / "a.off", small_file(1))
    settings = settings_in(tmp_path, workers=1, source_roots=(str(tmp_path),))
    with serving(settings, watches=True) as running, monkeypatch.context() as patch:
        patch.setattr(storing, "ingest", slowly)
        with Library.of(running, root) as library:
            patch.undo()
            assert library.read()["scan"]["seconds"] >= stored
            put(root / "b.off", small_file(2))
            wait_until(lambda: "b.off" in library.files(), seconds=0.75 * scanner.REST * stored)
            # The system reports no event when a folder itself goes and comes.
            root.rename(tmp_path / "away")
            wait_until(lambda: library.read()["state"] == "offline", seconds=30)
            (tmp_path / "away").rename(root)
            wait_until(lambda: library.read()["state"] == "ready", seconds=30)


def test_a_scan_that_was_cut_off_is_continued(
    running: Running, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each file has its shape or none, so that the next scan ends right and stores nothing twice."""
    for number in range(1, 4):
        put(root / f"{number}.off", small_file(number))
    begun, stored = [], []

    async def cut_off(*arguments: Any, **named: Any) -> Any:
        begun.append(arguments)
        if len(begun) > 1:
            while not stored:
                await asyncio.sleep(0.01)
            raise RuntimeError("cut off")
        stored.append(await ingest(*arguments, **named))
        return stored[0]

    monkeypatch.setattr(storing, "ingest", cut_off)
    monkeypatch.setattr(scanner, "PAUSE_SECONDS", 0.0)
    with Library.of(running, root) as library:
        assert library.read()["detail"].startswith("the scan failed")
        (first,) = library.shapes().values()
        monkeypatch.setattr(storing, "ingest", ingest)
        assert library.rescan()["scan"]["stored"] == 2
        assert first in library.shapes().values()
        assert len(set(library.shapes().values())) == running.client.get("/shapes").json()["total"] == 3


def test_one_file_in_two_sources_is_one_shape(library: Library, root: Path, tmp_path: Path) -> None:
    """A folder in a folder, and a hard link elsewhere; a source that goes leaves the shape to the other."""
    running, shapes = library.running, library.shapes()
    with Library.of(running, root / "inner") as inner:
        assert inner.shapes() == {
            "b.off": shapes["inner/b.off"],
            "copy of a.off": shapes["inner/copy of a.off"],
        }
        os.link(root / "a.off", tmp_path / "models" / "inner" / "link.off")
        assert inner.rescan()["scan"]["copies"] == 1
        assert inner.shapes()["link.off"] == shapes["a.off"]
        some = inner.files(shape_id=[shapes["a.off"], shapes["a.off"].replace("0", "1")])
        assert some.keys() == {"copy of a.off", "link.off"}
    assert running.client.get("/shapes").json()["total"] == 2
    assert library.rescan()["state"] == "ready"


def test_files_that_are_there_more_than_once_are_listed_by_shape(
    library: Library, root: Path, tmp_path: Path
) -> None:
    """Also those of which the other is in another source, on all pages, while both are there."""
    other = tmp_path / "other"
    put(other / "b again.off", small_file(2))
    put(root / "last.off", small_file(1))
    library.rescan()
    triple = {"a.off", "inner/copy of a.off", "last.off"}
    assert set(library.files(equal=True)) == triple
    with Library.of(library.running, other) as elsewhere:
        assert set(elsewhere.files(equal=True)) == {"b again.off"}
        paths, cursor = [], None
        while not paths or cursor:
            page = library.running.client.get(
                f"/sources/{library.id}/files",
                params={"equal": True, "limit": 1} | ({"cursor": cursor} if cursor else {}),
            ).json()
            assert page["total"] == 4
            paths += [file["path"] for file in page["files"]]
            cursor = page["next_cursor"]
        assert len(paths) == 4
        assert triple in ({*paths[:3]}, {*paths[1:]})
        (other / "b again.off").rename(tmp_path / "gone.off")
        put(other / "c.off", small_file(4))
        put(other / "d.off", small_file(5))
        elsewhere.rescan("confirm")
        assert set(library.files(equal=True)) == triple


def test_what_cannot_be_read_is_told_and_keeps_its_shape(
    library: Library, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mesh that became none, one that may not be opened, one that grows, and an editor's way to save."""
    shapes = library.shapes()
    put(root / "inner" / "b.off", b"OFF\nbroken")
    (root / "a.off").write_bytes(small_file(6))
    source = library.rescan()
    assert (source["scan"]["left"], source["counts"]["refused"]) == (1, 1)
    broken = library.files(state="refused")["inner/b.off"]
    assert broken["shape_id"] == shapes["inner/b.off"]
    assert broken["problem"]["type"] == "urn:isoshape:problem:malformed-mesh"
    put(root / "inner" / "b.off", small_file(2))
    os.utime(root / "inner" / "b.off", (1, 1))

    def refusing(folder: Path, path: str) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(reading, "open_beneath", refusing)
    assert library.rescan()["counts"]["unreadable"] == 1
    assert library.files()["inner/b.off"]["problem"]["detail"] == "Permission denied"
    monkeypatch.setattr(reading, "open_beneath", open_beneath)
    put(root / "b.off.tmp", small_file(7)).rename(root / "inner" / "b.off")
    assert library.rescan()["counts"] == {"present": 3, "missing": 0, "refused": 0, "unreadable": 0}
    assert library.shapes()["inner/b.off"] == shapes["inner/b.off"]


def test_equal_files_give_one_name_in_every_order(running: Running, root: Path) -> None:
    """That of the first path, unless a person gave another one."""
    put(root / "m.off", small_file(1))
    with Library.of(running, root) as library:
        (shape,) = library.shapes().values()

        def name() -> str:
            library.rescan()
            return str(running.client.get(f"/shapes/{shape}").json()["name"])

        put(root / "z.off", small_file(1))
        assert name() == "m.off"
        put(root / "a.off", small_file(1))
        assert name() == "a.off"
        os.link(root / "z.off", root / "0.off")
        assert name() == "0.off"
        (root / "0.off").unlink()
        (root / "a.off").unlink()
        assert name() == "m.off"
        assert running.client.patch(f"/shapes/{shape}", json={"name": "mine"}).status_code == 200
        put(root / "a.off", small_file(1))
        assert name() == "mine"


def test_a_folder_has_the_uploaded_shape_of_its_equal_files_whatever_their_names(
    running: Running, root: Path
) -> None:
    uploaded = running.store(small_file(1), "mine.off")
    for name in ("a.off", "mine.off", "z.off"):
        put(root / name, small_file(1))
    with Library.of(running, root) as library:
        assert set(library.shapes().values()) == {uploaded["id"]}
        assert library.read()["scan"]["stored"] == 0
        assert running.client.get(f"/shapes/{uploaded['id']}").json()["name"] == "mine.off"
    # The source that goes leaves the shape, which is not its own.
    assert running.client.get("/shapes").json()["total"] == 1


def test_a_shape_that_moves_to_another_collection_and_back_keeps_its_path(
    library: Library, root: Path
) -> None:
    """While it is elsewhere, the source shows no shape, and a changed file does not touch it."""
    running, shapes = library.running, library.shapes()
    b, a = shapes["inner/b.off"], shapes["a.off"]
    with working_in(running, "elsewhere") as elsewhere:
        for shape in (a, b):
            moved = running.client.patch(f"/shapes/{shape}", json={"collection": "elsewhere"})
            assert moved.status_code == 200, moved.text
        assert set(library.shapes().values()) == {None}
        assert library.rescan()["scan"]["done"] == 0
        assert elsewhere.client.get(f"/shapes/{b}/file").content == small_file(2)
        back = elsewhere.client.patch(f"/shapes/{b}", json={"collection": "default"})
        assert back.status_code == 200, back.text
        assert set(library.files(shape_id=b)) == {"inner/b.off"}
        put(root / "a.off", small_file(9))
        put(root / "inner" / "copy of a.off", small_file(9))
        assert library.rescan()["scan"]["stored"] == 1
        assert library.shapes()["a.off"] == library.shapes()["inner/copy of a.off"] not in {None, a}
        assert elsewhere.client.get(f"/shapes/{a}").status_code == 200
        elsewhere.clear()


def test_a_deleted_shape_stays_deleted_until_its_file_changes(library: Library, root: Path) -> None:
    client, shape = library.running.client, library.shapes()["inner/b.off"]
    assert client.delete(f"/shapes/{shape}").status_code == 204
    put(root / "again.off", small_file(2))
    library.rescan()
    assert library.shapes()["inner/b.off"] is library.shapes()["again.off"] is None
    put(root / "inner" / "b.off", small_file(8))
    library.rescan()
    assert library.shapes()["inner/b.off"] not in {None, shape}


def test_a_scan_goes_on_when_shapes_and_files_of_it_are_erased_meanwhile(
    library: Library, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writing = storing.FileStorer._put

    def late(self: Any, session: WriteSession, *arguments: Any) -> None:
        erase(session, ShapeRow.number == arguments[3]["shape_number"])
        repository.update_all(session, [{"number": 10**9, "state": "present"}])
        writing(self, session, *arguments)

    monkeypatch.setattr(storing.FileStorer, "_put", late)
    put(root / "again.off", small_file(2))
    assert library.rescan()["state"] == "ready"
    assert library.shapes()["inner/b.off"] is library.shapes()["again.off"] is None


def test_copies_are_downloaded_although_the_folder_is_gone(
    running: Running, root: Path, undo: list[timedelta]
) -> None:
    """And without deletions that can be undone, a missing file's shape goes at once."""
    put(root / "a.off", small_file(1))
    put(root / "b.off", small_file(2))
    put(root / "c.off", small_file(3))
    with Library.of(running, root, copies=True) as library:
        shape = library.shapes()["a.off"]
        (root / "a.off").unlink()
        library.rescan()
        assert running.client.get(f"/shapes/{shape}/file").content == small_file(1)
        undo.append(timedelta(0))
        library.rescan()
        assert set(library.files()) == {"b.off", "c.off"}
        assert_problem(running.client.get(f"/shapes/{shape}"), 404, "shape-not-found")
