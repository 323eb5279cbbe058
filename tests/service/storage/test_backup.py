"""Backups: whole whatever happens meanwhile, and put back only where that loses nothing unasked."""

import errno
import os
import resource
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.cli.commands import command_line
from service.errors import ArchiveError, ArchiveTooNewError, StorageUnavailableError
from service.storage.backup import back_up, restore
from service.storage.checking import check
from service.storage.database import Database
from service.storage.sqlite import ArchiveLock
from tests.service.archives import change, make_archive, names, opened
from tests.service.processes import server


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    return make_archive(tmp_path / "here" / "archive.sqlite3", 0, 1)


@pytest.fixture
def target(tmp_path: Path) -> Path:
    (tmp_path / "there").mkdir()
    return tmp_path / "there" / "backup.sqlite3"


def test_a_backup_is_of_one_moment_while_another_process_writes(archive: Path, target: Path) -> None:
    with opened(archive) as other:
        other.execute("BEGIN IMMEDIATE")
        other.execute("UPDATE shapes SET name = 'half done'")
        back_up(archive, target)
        other.execute("ROLLBACK")
    assert names(target) == ["0", "1"]


def test_nothing_is_replaced_unasked(archive: Path, target: Path) -> None:
    target.write_text("dear")
    with pytest.raises(ArchiveError, match="is there already"):
        back_up(archive, target)
    assert target.read_text() == "dear"
    assert back_up(archive, target, replace=True).shapes == 2
    assert names(target) == ["0", "1"]
    for replace in (False, True):
        with pytest.raises(ArchiveError, match="the archive itself"):
            back_up(archive, archive, replace=replace)
    assert sorted(path.name for path in target.parent.iterdir()) == [target.name]


def test_a_damaged_archive_is_neither_backed_up_nor_restored(archive: Path, target: Path) -> None:
    shutil.copy(archive, target)
    change(target, "UPDATE blobs SET data = x'00', size = 1 WHERE number = 2")
    bad = target.rename(target.with_name("bad.sqlite3"))
    with pytest.raises(ArchiveError, match="blob 2 does not have the SHA-256"):
        back_up(bad, target)
    with pytest.raises(ArchiveError, match="blob 2 does not have the SHA-256"):
        restore(bad, target)
    with pytest.raises(ArchiveError, match="blob 2 does not have the SHA-256"):
        restore(bad, archive, replace=True)
    assert names(archive) == ["0", "1"]
    assert not target.exists()
    assert not list(target.parent.glob(".*"))


def test_a_full_disk_leaves_what_was_there(archive: Path, target: Path) -> None:
    target.write_text("dear")

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))

    done = subprocess.run(
        [sys.executable, "-B", "-P", "-m", "service.cli", "backup", target, "--force"],
        env={"ISOSHAPE_DATABASE_URL": f"sqlite:///{archive}"},
        preexec_fn=limit,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "cannot be copied" in done.stderr
    assert done.stderr.count("\n") == 1
    assert target.read_text() == "dear"
    assert [path.name for path in target.parent.iterdir()] == [target.name]


def test_an_archive_that_holds_shapes_is_replaced_only_when_asked(archive: Path, target: Path) -> None:
    back_up(archive, target)
    other = make_archive(archive.with_name("other.sqlite3"), 2)
    with pytest.raises(ArchiveError, match="not empty"):
        restore(target, other)
    assert names(other) == ["2"]
    other.chmod(0o640)
    assert restore(target, other, replace=True).shapes == 2
    assert names(other) == ["0", "1"]
    assert other.stat().st_mode & 0o777 == 0o640
    empty = make_archive(archive.with_name("empty.sqlite3"))
    restore(target, empty)
    assert names(empty) == ["0", "1"]


@pytest.mark.parametrize("content", [b"something of somebody's", b"SQLite format 3\0" + bytes(4096)])
def test_a_file_that_is_no_archive_is_replaced_only_when_asked(
    archive: Path, target: Path, content: bytes
) -> None:
    back_up(archive, target)
    strange = archive.with_name("strange")
    strange.write_bytes(content)
    with pytest.raises(ArchiveError, match="not empty"):
        restore(target, strange)
    assert strange.read_bytes() == content
    restore(target, strange, replace=True)
    assert names(strange) == ["0", "1"]


def half_done(archive: Path, folder: Path) -> Path:
    """The archive as a process leaves it that is killed while it commits: its file written, and a journal."""
    with opened(archive) as connection:
        connection.execute("PRAGMA journal_mode = TRUNCATE")
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("UPDATE blobs SET data = zeroblob(length(data))")
        connection.execute("UPDATE shapes SET name = 'half done ' || number")
        left = folder / "left.sqlite3"
        shutil.copy(archive, left)
        shutil.copy(f"{archive}-journal", f"{left}-journal")
        connection.execute("ROLLBACK")
    assert left.read_bytes() != archive.read_bytes()
    return left


def test_the_archive_of_a_killed_process_is_recovered_and_then_checked(archive: Path, tmp_path: Path) -> None:
    left = half_done(archive, tmp_path)
    assert check(left, lock_seconds=1).faults == []
    assert left.read_bytes() == archive.read_bytes()


def test_a_journal_that_was_left_is_not_played_into_what_is_restored(
    archive: Path, target: Path, tmp_path: Path
) -> None:
    left = half_done(archive, tmp_path)
    with pytest.raises(ArchiveError, match="in use"):
        restore(left, target)
    assert not target.exists()
    backup = make_archive(target, 2, 3, 4)
    restore(backup, left, replace=True)
    assert names(left) == ["2", "3", "4"]
    assert check(left, lock_seconds=1).faults == []


# A reader that has not yet seen the journal: a process of its own, for locks are those of a process.
LOCKED = """
import fcntl, sys
file = open(sys.argv[1], "r+b")
fcntl.lockf(file, fcntl.LOCK_SH, 510, 0x40000002)
print("locked", flush=True)
sys.stdin.read()
"""


def test_an_archive_whose_journal_cannot_be_applied_now_stays_with_it(
    archive: Path, target: Path, tmp_path: Path
) -> None:
    left = half_done(archive, tmp_path)
    backup = make_archive(target, 2, 3, 4)
    holder = subprocess.Popen(
        [sys.executable, "-c", LOCKED, str(left)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"locked\n"
    with pytest.raises(ArchiveError, match=r"the journal of .* cannot be applied: .*SQLITE_BUSY"):
        restore(backup, left, replace=True)
    holder.communicate()
    assert names(left) == ["0", "1"]
    assert check(left, lock_seconds=1).faults == []


def test_a_disk_that_fails_is_no_fault_of_the_program(
    archive: Path, target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_arguments: object, **_named: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    for name in ("fsync", "replace", "unlink"):
        with monkeypatch.context() as patch:
            patch.setattr(os, name, fail)
            if name == "unlink":
                patch.setattr(os, "fsync", fail)
            with pytest.raises(ArchiveError, match="cannot be written: Input/output error"):
                back_up(archive, target)
            assert not target.exists()
    back_up(archive, target)


def test_an_archive_in_use_is_not_replaced(archive: Path, target: Path) -> None:
    back_up(archive, target)
    database = Database(f"sqlite:///{archive}", lock_seconds=1)
    for replace in (False, True):
        with pytest.raises(StorageUnavailableError, match="is using it"):
            restore(target, archive, replace=replace)
    second = Database(f"sqlite:///{archive}", lock_seconds=1)
    database.close()
    with pytest.raises(StorageUnavailableError, match="is using it"):
        restore(target, archive, replace=True)
    second.close()
    restore(target, archive, replace=True)
    with server(archive.parent) as (process, _):
        with pytest.raises(StorageUnavailableError):
            restore(target, archive, replace=True)
        process.kill()
        process.wait()
        restore(target, archive, replace=True)


def test_a_service_does_not_start_while_an_archive_is_put_in_place(archive: Path) -> None:
    with ArchiveLock(archive, alone=True), pytest.raises(StorageUnavailableError, match="in its place"):
        Database(f"sqlite:///{archive}", lock_seconds=1)
    Database(f"sqlite:///{archive}", lock_seconds=1).close()


def newer(path: Path) -> None:
    change(path, "UPDATE alembic_version SET version_num = '9999'")


def another_database(path: Path) -> None:
    path.unlink()
    change(path, "CREATE TABLE shapes (name)")


def text(path: Path) -> None:
    path.write_text("text " * 10_000)


@pytest.mark.parametrize(
    ("spoil", "error", "message"),
    [
        (newer, ArchiveTooNewError, "9999"),
        (another_database, ArchiveError, "no Isoshape archive"),
        (text, ArchiveError, "SQLITE_NOTADB"),
        (Path.unlink, ArchiveError, "there is no"),
    ],
)
def test_a_file_that_is_no_archive_of_this_version_is_refused(
    archive: Path, target: Path, spoil: Callable[[Path], None], error: type[Exception], message: str
) -> None:
    other = Path(shutil.copy(archive, archive.with_name("other.sqlite3")))
    spoil(other)
    with pytest.raises(error, match=message):
        back_up(other, target)
    with pytest.raises(error, match=message):
        restore(other, target)
    with pytest.raises(error, match=message):
        restore(other, archive, replace=True)
    assert names(archive) == ["0", "1"]
    assert not target.exists()


def test_a_folder_that_is_not_there(archive: Path, target: Path) -> None:
    with pytest.raises(ArchiveError, match="cannot be written"):
        back_up(archive, target.parent / "not there" / "backup.sqlite3")
    back_up(archive, target)
    restore(target, target.parent / "new" / "folder" / "archive.sqlite3")
    assert names(target.parent / "new" / "folder" / "archive.sqlite3") == ["0", "1"]


def test_a_backup_that_another_process_holds_up_says_so(
    archive: Path, target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.storage.backup.LOCK_SECONDS", 0.1)
    with opened(archive) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(ArchiveError, match="SQLITE_BUSY"):
            back_up(archive, target)
    assert not target.exists()


def test_the_commands(archive: Path, target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", f"sqlite:///{archive}")
    runner = CliRunner()
    app = command_line()
    done = runner.invoke(app, ["backup", str(target)])
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("2 shapes on 2 files of ")
    done = runner.invoke(app, ["recover", str(target)])
    assert done.exit_code == 1
    assert done.stderr == f"isoshape: {archive} is not empty\n"
    change(archive, "UPDATE shapes SET name = 'changed'")
    assert runner.invoke(app, ["recover", str(target), "--force"]).exit_code == 0
    assert names(archive) == ["0", "1"]
    with sqlite3.connect(archive) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    connection.close()
