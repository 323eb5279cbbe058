"""The files under a folder: names in any form, links, patterns, and what cannot be listed."""

import os
import unicodedata
from pathlib import Path

import pytest

from service.errors import FileTooLargeError
from service.sources import reading
from service.sources.reading import FileInMotionError, FileUnreadableError, read_file
from service.sources.rules import PATTERNS
from service.sources.walk import DEPTH, RootMissingError, Tree, find_files
from service.sources.watching import file_system
from service.storage.in_place import open_beneath
from tests.service.sources.support import put


def found(root: Path) -> set[str]:
    return set(find_files(root).files)


def test_names_in_every_normal_form_are_one_path(root: Path) -> None:
    """A disk that gives NFD one day and NFC the next has the same files; both at once are two files."""
    name = "Åéñ 크.off"
    composed, decomposed = (unicodedata.normalize(form, name) for form in ("NFC", "NFD"))
    put(root / decomposed, b"1")
    assert found(root) == {composed}
    (root / decomposed).rename(root / composed)
    assert found(root) == {composed}
    put(root / decomposed, b"2")
    tree = find_files(root)
    assert {key: tree.files[key].path for key in tree.files} == {composed: composed, decomposed: decomposed}
    # NFKC also changes what a name says: ﬁ and fi are two names.
    put(root / "ﬁ.off", b"3")
    put(root / "fi.off", b"4")
    assert {"ﬁ.off", "fi.off"} < found(root)


def test_links_end_and_stay_inside(root: Path) -> None:
    put(root / "inner" / "a.off", b"1")
    put(root.parent / "outside.off", b"2")
    (root / "loop").symlink_to(root)
    (root / "inner" / "up").symlink_to("..")
    (root / "x.off").symlink_to("y.off")
    (root / "y.off").symlink_to("x.off")
    (root / "dangling.off").symlink_to("nowhere.off")
    (root / "out.off").symlink_to(root.parent / "outside.off")
    (root / "second.off").symlink_to("inner/a.off")
    os.link(root / "inner" / "a.off", root / "third.off")
    os.mkfifo(root / "pipe.off")
    tree = find_files(root)
    assert set(tree.files) == {"inner/a.off", "second.off", "third.off"}
    assert len({(file.device, *file.same_bytes) for file in tree.files.values()}) == 1
    assert tree.unread == {}
    for path in ("out.off", "../outside.off", "/etc/passwd", "pipe.off", "x.off", "loop"):
        with pytest.raises(OSError, match=r".+"):
            os.close(open_beneath(root, path))


def test_a_folder_swapped_for_a_link_is_not_followed(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By another process, between the look at the path and its opening."""
    put(root / "inner" / "a.off", b"1")
    put(root.parent / "secret" / "a.off", b"2")
    (root / "inner").rename(root.parent / "away")
    (root / "inner").symlink_to(root.parent / "secret")
    monkeypatch.setattr(os.path, "realpath", str)
    with pytest.raises(OSError, match=r"Not a directory|Too many levels"):
        os.close(open_beneath(root, "inner/a.off"))


def test_patterns_and_hidden_names_are_left_out(root: Path) -> None:
    for name in ("a.off", "b.OFF", ".c.off", ".hidden/d.off", "old/e.off", "old/keep.off", "f.draft.off"):
        put(root / name, b"1")
    assert found(root) == {"a.off", "b.OFF", "old/e.off", "old/keep.off", "f.draft.off"}
    put(root / ".isoshapeignore", b"old/*\n!old/keep.off\n*.draft.off\n")
    assert found(root) == {"a.off", "b.OFF", "old/keep.off"}


@pytest.mark.parametrize(
    ("patterns", "cause"),
    [(b"!\n", "no pattern"), (b"".join(b"%d/\n" % number for number in range(PATTERNS + 1)), "patterns")],
    ids=["none", "many"],
)
def test_wrong_patterns_leave_the_folder_unread(root: Path, patterns: bytes, cause: str) -> None:
    put(root / "a.off", b"1")
    put(root / ".isoshapeignore", b"# *****\n\n  \n*/**/a*.off\n")
    assert found(root) == {"a.off"}
    put(root / ".isoshapeignore", patterns)
    with pytest.raises(RootMissingError, match=rf"\.isoshapeignore: .*{cause}"):
        find_files(root)


def test_what_cannot_be_listed_is_told_and_not_taken_for_gone(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder that may not be listed, one that is too deep, and a root that vanishes during the walk."""
    put(root / "a.off", b"1")
    put(root / "shut" / "b.off", b"1")
    deep = "/".join(["d"] * (DEPTH + 1))
    put(root / deep / "c.off", b"1")
    scandir = os.scandir

    def refusing(folder: int) -> object:
        if os.path.samestat(os.fstat(folder), (root / "shut").stat()):
            raise PermissionError(13, "Permission denied")
        return scandir(folder)

    monkeypatch.setattr(os, "scandir", refusing)
    tree = find_files(root)
    assert set(tree.files) == {"a.off"}
    assert tree.unread["shut"] == "Permission denied"
    assert tree.may_have("shut/b.off")
    assert tree.may_have(f"{deep}/c.off")
    assert not tree.may_have("shutter.off")
    assert Tree().may_have("a.off") is False
    monkeypatch.setattr(os, "scandir", lambda _: (_ for _ in ()).throw(OSError(5, "Input/output error")))
    with pytest.raises(RootMissingError, match="Input/output error"):
        find_files(root)
    with pytest.raises(RootMissingError, match="No such file"):
        find_files(root / "absent")


def test_a_name_that_is_no_text_is_told(root: Path) -> None:
    (root / os.fsdecode(b"\xff.off")).touch()
    assert list(find_files(root).unread.values()) == ["the name is not UTF-8"]


def test_a_file_is_read_whole_or_not_at_all(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(root / "a.off", b"0123456789")
    (file,) = find_files(root).files.values()
    assert read_file(root, file, 10) == b"0123456789"
    with pytest.raises(FileTooLargeError):
        read_file(root, file, 9)
    # It grows slowly: it was written a moment ago, or since the walk, or while it is read.
    path.write_bytes(b"01234567890")
    with pytest.raises(FileInMotionError):
        read_file(root, file, 100)
    (grown,) = find_files(root).files.values()
    with pytest.raises(FileInMotionError):
        read_file(root, grown, 100)
    monkeypatch.setattr(reading, "QUIET_SECONDS", 0.0)
    assert read_file(root, grown, 100) == b"01234567890"
    state = reading._state

    def growing(descriptor: int) -> tuple[int, int, int]:
        now = state(descriptor)
        with path.open("ab") as growth:
            growth.write(b"1")
        return now

    monkeypatch.setattr(reading, "_state", growing)
    with pytest.raises(FileInMotionError):
        read_file(root, grown, 100)
    path.unlink()
    with pytest.raises(FileInMotionError):
        read_file(root, grown, 100)
    path.symlink_to("/etc/hostname")
    with pytest.raises(FileUnreadableError):
        read_file(root, grown, 100)


def test_the_file_system_is_that_of_the_longest_mount() -> None:
    mounts = [
        "22 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw",
        "90 22 0:44 / /srv/my\\040models rw shared:50 - nfs4 nas:/models rw,vers=4.2",
        "91 90 0:45 / /srv/my\\040models/local rw - xfs /dev/sdb rw",
    ]
    kinds = {"/srv": "ext4", "/srv/my models/a": "nfs4", "/srv/my models/local": "xfs"}
    assert {folder: file_system(mounts, folder) for folder in kinds} == kinds
    assert file_system([], "/srv") == ""
