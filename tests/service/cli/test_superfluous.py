"""`isoshape library equal --apply`: a file goes only if the kept one is there as another file."""

import os
import shutil
import subprocess
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, cast

import pytest
import typer

from service.cli import superfluous
from service.client import Client
from service.sources.schemas import FileGroup, GroupedFile

NAMES = [
    "plain.off",
    'it\'s "quoted" $(touch ran) `touch ran` \\ $HOME.off',
    "-rf.off",
    "-rf *\n#\ntouch ran\n.off",
    "ünïcode\u2028\x1b[31m.off",
    "folder\n'; touch ran; '/a.off",
]


def grouped(path: Path, role: Literal["kept", "equal", "merged"], left: str | None = None) -> GroupedFile:
    data = path.read_bytes()
    digest = sha256(data).hexdigest()
    return GroupedFile(source_id="1", path=str(path), bytes=len(data), sha256=digest, role=role, left=left)


def put(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def client_of(root: Path) -> Client:
    """A client of a service with one source."""
    source = SimpleNamespace(id="1", name="models", path=str(root), state="ready")
    return cast(Client, SimpleNamespace(sources=lambda: SimpleNamespace(sources=[source])))


Apply = Callable[[list[FileGroup]], str]
"""Remove or move the files of groups; what is told."""


@pytest.fixture(params=["script", "move"])
def apply(request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Apply:
    def script(groups: list[FileGroup]) -> str:
        place = tmp_path / "a script.sh"
        place.unlink(missing_ok=True)
        superfluous.write_script(groups, str(place))
        return subprocess.run(
            ["sh", place], capture_output=True, text=True, check=True, cwd=tmp_path, stdin=subprocess.DEVNULL
        ).stdout

    def move(groups: list[FileGroup]) -> str:
        with suppress(typer.Exit):
            superfluous.move(client_of(tmp_path / "models"), groups, str(tmp_path / "moved"))
        told = capsys.readouterr()
        return told.out + told.err

    return script if request.param == "script" else move


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "models"


def group(root: Path, kept: str, *others: str, role: Literal["equal", "merged"] = "equal") -> FileGroup:
    return FileGroup(files=[grouped(root / kept, "kept"), *(grouped(root / path, role) for path in others)])


def test_names_of_any_kind_go_and_nothing_else_runs(root: Path, tmp_path: Path, apply: Apply) -> None:
    for name in NAMES:
        put(root / name, b"one")
    kept = put(root / "kept" / NAMES[1], b"one")
    stays = put(root / "another.off", b"another")
    wanted = [group(root, f"kept/{NAMES[1]}", *NAMES)]
    apply(wanted)
    assert sorted(path for path in root.rglob("*") if path.is_file()) == sorted([kept, stays])
    moved = {path.read_bytes() for path in tmp_path.glob("moved/**/*.off")}
    assert moved <= {b"one"}
    assert not [*tmp_path.rglob("ran")]
    # A second run finds nothing.
    apply(wanted)
    assert (kept.read_bytes(), stays.read_bytes()) == (b"one", b"another")


def change(path: Path) -> None:
    path.write_bytes(b"two")


def delete(path: Path) -> None:
    path.unlink()


def link_to(other: str) -> Callable[[Path], None]:
    def link(path: Path) -> None:
        path.unlink()
        path.symlink_to(other)

    return link


def hard_link(path: Path) -> None:
    path.unlink()
    os.link(path.with_name("kept.off" if path.name == "other.off" else "other.off"), path)


@pytest.mark.parametrize(
    ("path", "changed"),
    [
        ("kept.off", change),
        ("kept.off", delete),
        ("kept.off", link_to("other.off")),
        ("kept.off", hard_link),
        ("other.off", change),
        ("other.off", hard_link),
        ("other.off", link_to("kept.off")),
        ("other.off", link_to("third.off")),
    ],
)
@pytest.mark.parametrize("role", ["equal", "merged"])
def test_a_file_is_left_if_it_or_the_kept_one_is_not_as_it_was(
    root: Path, apply: Apply, path: str, changed: Callable[[Path], None], role: Literal["equal", "merged"]
) -> None:
    put(root / "kept.off", b"one")
    put(root / "other.off", b"one" if role == "equal" else b"a variant")
    put(root / "third.off", b"one")
    wanted = [group(root, "kept.off", "other.off", role=role)]
    changed(root / path)
    before = {each: (each.lstat().st_ino, each.read_bytes()) for each in root.iterdir()}
    assert "left" in apply(wanted)
    assert {each: (each.lstat().st_ino, each.read_bytes()) for each in root.iterdir()} == before


def test_a_link_in_a_path_is_not_followed(root: Path, tmp_path: Path, apply: Apply) -> None:
    put(root / "kept.off", b"one")
    put(root / "folder" / "other.off", b"one")
    wanted = [group(root, "kept.off", "folder/other.off")]
    (root / "folder").rename(tmp_path / "outside")
    (root / "folder").symlink_to(tmp_path / "outside")
    assert "left" in apply(wanted)
    assert (tmp_path / "outside" / "other.off").read_bytes() == b"one"


def test_a_merged_file_has_other_bytes_and_the_rest_is_left(root: Path, tmp_path: Path, apply: Apply) -> None:
    put(root / "kept.off", b"one")
    put(root / "variant.off", b"a variant")
    member = put(root / "a.zip" / "member.off", b"one")
    merged = group(root, "kept.off", "variant.off", role="merged")
    merged.files.append(grouped(member, "equal", left="it is in a zip"))
    apply([merged])
    assert {path.name for path in root.rglob("*.off")} == {"kept.off", "member.off"}
    assert {path.read_bytes() for path in tmp_path.glob("moved/**/*.off")} <= {b"a variant"}


def test_a_script_puts_a_file_back_that_takes_the_kept_one_along(root: Path, tmp_path: Path) -> None:
    """As on a mount whose inodes differ from those of another mount of the folder."""
    kept, other = put(root / "kept.off", b"one"), put(root / "other.off", b"one")
    place = tmp_path / "script.sh"
    superfluous.write_script([group(root, "kept.off", "other.off")], str(place))
    assert "may be a variant" in place.read_text()
    # A rename of one path renames the other.
    alias = put(tmp_path / "bin" / "mv", b'#!/bin/sh\nrm -f "$KEPT"\nexec /bin/mv "$@"\n')
    alias.chmod(0o755)
    environment = {"PATH": f"{alias.parent}:{os.environ['PATH']}", "KEPT": str(kept)}
    told = subprocess.run(["sh", place], env=environment, capture_output=True, text=True, check=True)
    assert "left: " in told.stdout
    assert other.read_bytes() == b"one"
    assert [path.name for path in root.iterdir()] == ["other.off"]
    # What an interrupted run left is not overwritten.
    put(root / "other.off.isoshape", b"of the owner")
    put(kept, b"one")
    told = subprocess.run(["sh", place], capture_output=True, text=True, check=True)
    assert told.stdout.startswith("left, since ")
    assert (root / "other.off.isoshape").read_bytes() == b"of the owner"
    assert other.exists()


def test_a_move_puts_a_file_back_that_takes_the_kept_one_along(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, other = put(root / "kept.off", b"one"), put(root / "other.off", b"one")
    wanted, unlink = [group(root, "kept.off", "other.off")], Path.unlink

    def both(path: Path, **options: Any) -> None:
        unlink(path, **options)
        if path == other:
            unlink(kept)

    monkeypatch.setattr(Path, "unlink", both)
    with pytest.raises(typer.Exit):
        superfluous.move(client_of(root), wanted, str(tmp_path / "moved"))
    assert "by another path" in capsys.readouterr().err
    assert other.read_bytes() == b"one"
    assert not [*(tmp_path / "moved").rglob("*.off")]


@pytest.mark.parametrize("linked", [True, False])
def test_a_move_keeps_paths_and_overwrites_nothing(
    root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    linked: bool,
) -> None:
    """On another file system the file is copied, and removed once the copy has its bytes."""
    for path in ("kept.off", "deep/other.off", "second.off"):
        put(root / path, b"one")
    os.utime(root / "deep/other.off", (1_600_000_000, 1_600_000_000))
    folder = tmp_path / "moved"
    target, taken = (folder / str(root / path).lstrip("/") for path in ("deep/other.off", "second.off"))
    put(taken, b"of the owner")
    wanted = [group(root, "kept.off", "deep/other.off", "second.off")]
    copy2 = shutil.copy2
    if not linked:

        def no_link(*_: object) -> None:
            raise OSError(18, "Invalid cross-device link")

        def while_written(of: Path, to: Path) -> None:
            copy2(of, to)
            of.write_bytes(b"new")

        def cut(_: Path, to: Path) -> None:
            to.write_bytes(b"on")

        monkeypatch.setattr(os, "link", no_link)
        for copy, bytes_then in ((cut, b"one"), (while_written, b"new")):
            monkeypatch.setattr(shutil, "copy2", copy)
            with pytest.raises(typer.Exit):
                superfluous.move(client_of(root), wanted, str(folder))
            assert (root / "deep/other.off").read_bytes() == bytes_then
            assert not target.exists()
        monkeypatch.setattr(shutil, "copy2", copy2)
        put(root / "deep/other.off", b"one")
        os.utime(root / "deep/other.off", (1_600_000_000, 1_600_000_000))
    with pytest.raises(typer.Exit) as exit:
        superfluous.move(client_of(root), wanted, str(folder))
    assert exit.value.exit_code == 1
    told = capsys.readouterr()
    assert told.out == f"moved {root}/deep/other.off to {target}\n"
    assert f"left: {root}/second.off" in told.err
    assert (target.read_bytes(), target.stat().st_mtime) == (b"one", 1_600_000_000)
    assert (taken.read_bytes(), (root / "second.off").read_bytes()) == (b"of the owner", b"one")
    assert not (root / "deep/other.off").exists()


def test_a_folder_that_is_in_a_source_or_holds_one_is_refused(root: Path, tmp_path: Path) -> None:
    put(root / "kept.off", b"one")
    put(root / "other.off", b"one")
    (tmp_path / "link").symlink_to(root)
    for folder in (root, root / "new" / "folder", tmp_path / "link" / "new", tmp_path, Path("/")):
        with pytest.raises(typer.Exit) as exit:
            superfluous.move(client_of(root), [group(root, "kept.off", "other.off")], str(folder))
        assert exit.value.exit_code == 2
    # A link below the folder leads out of it.
    below = tmp_path / "moved" / str(root).lstrip("/")
    below.parent.mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    below.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(typer.Exit):
        superfluous.move(client_of(root), [group(root, "kept.off", "other.off")], str(tmp_path / "moved"))
    assert sorted(path.name for path in root.iterdir()) == ["kept.off", "other.off"]


def test_files_of_another_machine_are_not_moved(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(root / "kept.off", b"one")
    put(root / "other.off", b"one")
    wanted = [group(root, "kept.off", "other.off")]
    root.rename(tmp_path / "elsewhere")
    with pytest.raises(typer.Exit):
        superfluous.move(client_of(root), wanted, str(tmp_path / "moved"))
    assert "move files where the service runs" in capsys.readouterr().err
    assert not (tmp_path / "moved").exists()


def test_a_script_overwrites_no_file(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = put(root / "kept.off", b"one")
    with pytest.raises(typer.Exit):
        superfluous.write_script([], str(model))
    assert "File exists" in capsys.readouterr().err
    assert model.read_bytes() == b"one"
