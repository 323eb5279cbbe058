"""`isoshape library`: a folder is added, listed, scanned, lost, found again and removed."""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from service.cli.service_address import serves
from service.client import Client
from service.storage.sqlite import ServingLock
from tests.service.cli.conftest import Run
from tests.service.sources.support import put
from tests.service.support import small_file

TAGS = ["printed", "2026", "mesh", "small", "first", "good"]


def rows(table: str) -> list[list[str]]:
    """The cells under the head of a table, but for the time of the scan."""
    return [line.split()[:5] for line in table.splitlines()[3:] if line.strip()]


def test_a_folder_from_its_addition_to_its_removal(archive: Client, tmp_path: Path, run: Run) -> None:
    at, folder = ("--url", archive.url), tmp_path / "models"
    put(folder / "a.off", small_file(1))
    put(folder / "bad.off", b"no mesh")
    rules = ("--rule", "*.off=mesh,small", "--rule", "other/=no", "--rule", "a.*=first")
    added = run("library", "add", folder, "--tags", "printed, 2026", *rules, *at)
    assert (added.status, rows(added.stdout)) == (0, [["models", "ready", "1", "0", "1"]])
    assert f"{folder}/bad.off: " in added.stderr
    (shape,) = archive.shapes()
    assert (shape.name, shape.tags) == ("a.off", TAGS[:-1])
    put(folder / "deep" / "copy.off", small_file(1))
    put(folder / "worse.off", b"no mesh either")
    rescan = run("library", "rescan", *at)
    assert (rescan.status, f"{folder}/worse.off: " in rescan.stderr) == (0, True)
    assert f"{folder}/bad.off" not in rescan.stderr
    assert "models: 1 file refused as before; `isoshape library list models`" in rescan.stderr
    listed = run("library", "list", "models", *at).stderr
    assert [f"{folder}/{path}: " in listed for path in ("bad.off", "worse.off")] == [True, True]
    (folder / "worse.off").unlink()
    places = {f"in the library {folder}/{path}" for path in ("a.off", "deep/copy.off")}
    assert places <= set(run("show", "a.off", *at).stdout.splitlines())
    (source,) = archive.sources().sources
    for of in ((), ("models",)):
        equal = run("library", "equal", *of, *at)
        assert equal.stdout.splitlines() == [f"kept    {folder}/a.off", f"equal   {folder}/deep/copy.off"]
        assert f"1 file of {len(small_file(1)):,} bytes can go" in equal.stderr
    assert not [*archive.source_files(source.id, shape_id=shape.id, state="missing")]
    assert not [*archive.source_files(source.id, shape_id=source.id)]
    assert run("library", "equal", "--apply", "script", tmp_path / "script.sh", *at).status == 0
    assert (folder / "deep" / "copy.off").exists()
    moved = run("library", "equal", "--merged", "--apply", "move", tmp_path / "moved", *at)
    assert (moved.status, moved.stdout.startswith(f"moved {folder}/deep/copy.off to ")) == (0, True)
    assert [path.name for path in (tmp_path / "moved").rglob("*.off")] == ["copy.off"]
    script = subprocess.run(["sh", tmp_path / "script.sh"], capture_output=True, text=True, check=True)
    assert script.stdout == f"gone already: {folder}/deep/copy.off\n"
    (folder / "deep").rmdir()
    assert run("library", "rescan", *at).status == 0
    assert "copy.off" not in run("show", "a.off", *at).stdout
    assert "is the source 'models' already" in run("library", "add", folder, *at).stderr

    folder.rename(tmp_path / "away")
    scanned = run("library", "rescan", *at)
    assert (scanned.status, rows(scanned.stdout)) == (1, [["models", "offline", "1", "0", "1"]])
    assert "models: the folder cannot be listed" in scanned.stderr
    confirmed = run("library", "confirm", "models", *at)
    assert (confirmed.status, rows(confirmed.stdout)) == (0, [["models", "ready", "0", "1", "0"]])
    (tmp_path / "away").rename(folder)
    ruled = run("library", "rule", "models", "--rule", "a*=good,first", *at)
    assert rows(ruled.stdout) == [["models", "ready", "1", "0", "1"]]
    assert run("library", "rule", "models", *at).status == 2
    assert archive.sources().sources[0].rules == {"a*": ["good", "first"]}
    assert run("library", "rule", "models", "--rule", "", *at).status == 0
    assert archive.sources().sources[0].rules == {}

    ruled = run("library", "rule", "--rule", "maker=A*=ann", *at)
    assert (ruled.status, rows(ruled.stdout)) == (0, [["maker=A*", "ann"]])
    assert rows(run("library", "rule", *at).stdout) == [["maker=A*", "ann"]]
    assert run("library", "rule", "--rule", "", *at).status == 0
    assert archive.rules().rules == {}

    assert run("library", "remove", folder, *at).status == 0
    none = run("library", *at)
    assert (rows(none.stdout), "no folders yet" in none.stderr) == ([], True)
    assert list(archive.shapes()) == []
    assert [deleted.id for deleted in archive.deleted()][-1:] == [shape.id]
    # The folder that is added again has its shape, with what people wrote about it.
    assert run("library", "add", folder, *at).status == 0
    assert [(again.id, again.tags) for again in archive.shapes()] == [(shape.id, TAGS)]
    assert run("library", "remove", "models", *at).status == 0
    assert (folder / "a.off").read_bytes() == small_file(1)


def test_a_folder_that_the_service_refuses_is_added_through_its_archive(
    archive: Client, database: Path, run: Run, monkeypatch: pytest.MonkeyPatch, outside: Path
) -> None:
    put(outside / "a.off", small_file(77))
    at = ("--url", archive.url)
    add = ("library", "add", outside, "--name", "my models", *at)
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", f"sqlite:///{database}")
    # No service has the lock; then one at another port has it; then one whose key is not that of the command.
    assert "ISOSHAPE_SOURCE_ROOTS" in run(*add).stderr
    with ServingLock(database, "http://127.0.0.1:1"):
        assert "ISOSHAPE_SOURCE_ROOTS" in run(*add).stderr
    with ServingLock(database, archive.url):
        assert "ISOSHAPE_SOURCE_ROOTS" in run(*add, "--key", "some").stderr
        assert "'/none' is not a folder" in run("library", "add", "/none", *at).stderr
        put(outside / "bad.off", b"no mesh")
        assert run(*add).status == 0
        assert [shape.name for shape in archive.shapes()] == ["a.off"]
        scan = archive.sources().sources[0].scan
        assert (scan.due, scan.done, scan.stored, scan.refused) == (2, 2, 1, 1)
        assert "`isoshape library list 'my models'`" in run("library", "rescan", *at).stderr
        assert run("library", "remove", outside, *at).status == 0


@pytest.fixture
def outside() -> Iterator[Path]:
    """A folder that is in none of the folders of ISOSHAPE_SOURCE_ROOTS."""
    with TemporaryDirectory() as folder:
        yield Path(folder)


@pytest.mark.parametrize(
    ("url", "held", "is_served"),
    [
        ("http://127.0.0.1:8000", "http://127.0.0.1:8000", True),
        ("http://localhost:8000/", "http://127.0.0.1:8000", True),
        ("http://127.0.0.1:8000", "http://0.0.0.0:8000", True),
        ("http://[::1]:8000", "http://[::]:8000", True),
        ("http://127.0.0.1:8001", "http://127.0.0.1:8000", False),
        ("http://192.0.2.1:8000", "http://127.0.0.1:8000", False),
        ("http://192.0.2.1:8000", "http://0.0.0.0:8000", False),
    ],
)
def test_a_service_serves_the_archive_whose_lock_has_its_address(
    tmp_path: Path, url: str, held: str, is_served: bool
) -> None:
    with ServingLock(tmp_path / "a.sqlite3", held):
        assert serves(url, f"sqlite:///{tmp_path}/a.sqlite3") == is_served
    assert not serves(held, f"sqlite:///{tmp_path}/a.sqlite3")
    assert not serves(held, "postgresql+psycopg://someone@127.0.0.1/archive")


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("add",), 2, "library add needs a name"),
        (("list", "--merged"), 2, "options of library equal"),
        (("equal", "--apply", "delete", "all"), 2, "script FILE or move DIR"),
        (("add", "/", "--rule", "brackets/"), 2, "write a pattern, = and tags"),
        (("add", "/"), 1, "ISOSHAPE_SOURCE_ROOTS"),
        (("remove", "no such"), 1, "there is no source 'no such'"),
    ],
)
def test_mistakes_are_told(
    archive: Client, run: Run, arguments: tuple[str, ...], status: int, words: str
) -> None:
    done = run("library", *arguments, "--url", archive.url)
    assert done.status == status
    assert words in done.stderr
