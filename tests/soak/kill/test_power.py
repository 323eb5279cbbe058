"""What a loss of power leaves: nothing but what was synced is certain."""

from pathlib import Path
from typing import Any

import pytest

from tests.soak.kill.power import Content, Disk, Operation, found, operations, put


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with one file, both synced."""
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "old").write_bytes(b"old")
    return folder


def after(folder: Path, *done: tuple[str, str] | tuple[str, str, bytes | str]) -> Disk:
    """The disk after operations: kind, name, and data or another name. A file's number is its length."""
    disk = Disk(folder)
    disk._inodes[len("old")] = next(iter(disk._inodes.values()))
    for kind, name, *rest in done:
        value = rest[0] if rest else b""
        data = value if isinstance(value, bytes) else b""
        other = str(folder / value) if isinstance(value, str) else ""
        disk.do(Operation(kind, len(name), 0, len(data), str(folder / name if name else folder), other, data))
    return disk


def names(content: Content) -> dict[str, bytes | None]:
    return {Path(name).name: data for name, data in content.items()}


WRITTEN = (("create", "new1"), ("write", "new1", b"new"))
SYNCED = (*WRITTEN, ("sync", "new1"))
RENAMED = (*SYNCED, ("rename", "new1", "old"))


@pytest.mark.parametrize(
    ("done", "present", "synced"),
    [
        ((), {"old": b"old"}, {"old": b"old"}),
        ((("write", "old", b"ne"),), {"old": b"ned"}, {"old": b"old"}),
        ((("write", "old", b"ne"), ("sync", "old")), {"old": b"ned"}, {"old": b"ned"}),
        ((("truncate", "old"),), {"old": b""}, {"old": b"old"}),
        ((("allocate", "old", b"12345"),), {"old": b"old\0\0"}, {"old": b"old"}),
        (SYNCED, {"old": b"old", "new1": b"new"}, {"old": b"old"}),
        ((*WRITTEN, ("sync folder", "")), {"old": b"old", "new1": b"new"}, {"old": b"old", "new1": b""}),
        (RENAMED, {"old": b"new"}, {"old": b"old"}),
        ((*RENAMED, ("sync folder", "")), {"old": b"new"}, {"old": b"new"}),
        ((("remove", "old"),), {}, {"old": b"old"}),
        ((("remove", "old"), ("sync folder", "")), {}, {}),
        ((("make folder", "made"), ("sync folder", "made")), {"old": b"old", "made": None}, {"old": b"old"}),
    ],
)
def test_what_is_there_and_what_is_certain(
    folder: Path, done: tuple[Any, ...], present: Content, synced: Content
) -> None:
    disk = after(folder, *done)
    assert names(disk.content()) == present
    assert names(disk.synced()) == synced


def test_some_of_what_is_unsynced_may_be_there_to_a_sector(folder: Path) -> None:
    disk = after(folder, ("truncate", "old"), ("write", "old", b"x" * 1100), ("write", "old", b"yy"))
    seen = {names(disk.partly_synced(seed))["old"] for seed in range(200)}
    once = {b"old", b"", b"x" * 512, b"x" * 1100}
    assert seen == once | {b"yy" + data[2:] for data in once}


def test_what_is_put_is_found(folder: Path) -> None:
    content = {str(folder / "made"): None, str(folder / "made" / "file"): b"data"}
    put(content, folder)
    assert found(folder) == content


def test_a_log_is_read_as_it_is_written() -> None:
    log = b"write\t7\t2\t3\t/a\t\na\nbrename\t0\t0\t0\t/a\t/b\n"
    assert list(operations(log)) == [
        Operation("write", 7, 2, 3, "/a", "", b"a\nb"),
        Operation("rename", 0, 0, 0, "/a", "/b", b""),
    ]
