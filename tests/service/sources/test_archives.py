"""Zip files in a folder: their meshes are files of the source."""

from pathlib import Path

import pytest

from service.compute.sandbox import zip_directory
from service.errors import TaskTimeLimitError
from service.sources import archives
from service.sources.reading import FileUnreadableError
from service.sources.walk import find_files
from tests.service.engines import on_both
from tests.service.jobs.support import pack
from tests.service.sources.support import Library, put
from tests.service.support import Running, small_file

pytestmark = on_both

KIT = {
    "a.off": small_file(1),
    "inner/b.off": small_file(2),
    "broken.off": small_file(2)[:500],
    "notes.txt": b"no mesh",
    ".hidden/a.off": small_file(3),
    "left out/c.off": small_file(4),
}


def test_the_meshes_of_a_zip_are_files_of_its_source(running: Running, root: Path) -> None:
    """They keep their shapes when the zip is moved or written again, and are missing when it is gone."""
    client = running.client
    put(root / "plain" / "copy of a.off", small_file(1))
    put(root / "kit.zip", pack(KIT))
    put(root / "damaged.zip", b"PK\x03\x04 and no more")
    (root / ".isoshapeignore").write_text("left out/\n")
    with Library.of(running, root) as library:
        source, shapes = library.read(), library.shapes()
        assert set(shapes) == {
            "kit.zip/a.off",
            "kit.zip/broken.off",
            "kit.zip/inner/b.off",
            "plain/copy of a.off",
        }
        assert source["counts"] == {"present": 3, "missing": 0, "refused": 1, "unreadable": 0}
        assert list(source["scan"]["unread"]) == ["damaged.zip"]
        a, b = shapes["kit.zip/a.off"], shapes["kit.zip/inner/b.off"]
        assert shapes["plain/copy of a.off"] == a
        assert client.get(f"/shapes/{b}").json()["name"] == "b.off"

        assert library.rescan()["scan"]["done"] == 0

        (root / "kit.zip").rename(root / "plain" / "Kit 2.zip")
        assert library.rescan()["counts"]["present"] == 3
        assert library.shapes()["plain/Kit 2.zip/inner/b.off"] == b

        put(root / "plain" / "Kit 2.zip", pack({**KIT, "inner/b.off": small_file(5)}))
        assert library.rescan()["scan"]["changed"] == 1
        assert library.shapes()["plain/Kit 2.zip/inner/b.off"] == b
        assert library.shapes()["plain/Kit 2.zip/a.off"] == a
        assert client.get(f"/shapes/{b}/file").content == small_file(5)

        (root / "plain" / "Kit 2.zip").unlink()
        (root / "damaged.zip").unlink()
        assert library.rescan()["counts"] == {"present": 1, "missing": 1, "refused": 0, "unreadable": 0}
        assert client.get(f"/shapes/{b}/file").content == small_file(5)


def test_files_that_are_packed_keep_their_shapes_and_bytes(running: Running, root: Path) -> None:
    """A new member, and one that changes into a file that has vanished."""
    put(root / "a.off", small_file(1))
    put(root / "b.off", small_file(2))
    put(root / "kit.zip", pack({"x.off": small_file(3)}))
    with Library.of(running, root) as library:
        shapes = library.shapes()
        put(root / "kit.zip", pack({"x.off": small_file(1), "b.off": small_file(2)}))
        for name in ("a.off", "b.off"):
            (root / name).unlink()
        library.rescan()
        packed = library.shapes()
        assert packed["kit.zip/x.off"] == shapes["a.off"]
        assert packed["kit.zip/b.off"] == shapes["b.off"]
        for name, number in (("a.off", 1), ("b.off", 2)):
            assert running.client.get(f"/shapes/{shapes[name]}/file").content == small_file(number)


def test_a_member_is_unreadable_while_its_zip_is(running: Running, root: Path) -> None:
    """As if its directory had been forgotten, and there were no time to read it."""
    put(root / "kit.zip", pack({"a.off": small_file(1)}))
    settings, tree = running.container.settings, find_files(root)
    read = archives.Archives(root, settings, zip_directory, archives.Directories())
    assert read.add_members(tree) == 0
    (member,) = tree.files.values()

    def slow(*_: object) -> bytes:
        raise TaskTimeLimitError

    with pytest.raises(FileUnreadableError):
        archives.Archives(root, settings, slow, archives.Directories()).read(member)
    assert read.read(member) == small_file(1)


def test_an_unchanged_zip_is_read_once(running: Running, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(root / "kit.zip", pack({"a.off": small_file(1)}))
    with Library.of(running, root) as library:
        shapes = library.shapes()

        def reading(*_: object) -> None:
            raise AssertionError("the zip was read")

        monkeypatch.setattr(archives, "ZipArchive", reading)
        assert library.rescan()["state"] == "ready"
        assert library.shapes() == shapes
