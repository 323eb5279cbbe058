"""Commands of a new user: archives that do not exist or are newer, mistakes in names, stopped commands."""

import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from core.errors import UnknownFormatError
from core.io import format_of, readable
from service.cli import service_address
from service.client import Client
from service.storage.database import Database, migrate
from tests.service.cli.conftest import Run, mesh_bytes
from tests.service.support import small_file, wait_until


@pytest.mark.parametrize("command", ["query", "duplicates", "collections"])
def test_an_archive_that_does_not_exist_is_named_and_not_made(
    command: str, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service_address, "DEFAULT_PORT", 9)
    files = [cup] if command == "query" else []
    for place, more in (
        ("isoshape-data/isoshape.sqlite3", []),
        ("other/a.sqlite3", ["--url", "sqlite:///other/a.sqlite3"]),
    ):
        done = run(command, *files, *more)
        assert (done.status, done.stdout) == (1, "")
        assert done.stderr.splitlines() == [
            f"isoshape: there is no archive at sqlite:///{place}; `isoshape ingest` makes one"
        ]
    assert list(Path.cwd().iterdir()) == []


def test_step_is_a_format_only_where_it_is_installed(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for installed in (True, False):
        monkeypatch.setattr("core.io.formats.find_spec", lambda name, installed=installed: installed or None)
        assert ("step" in readable()) == installed
        with pytest.raises(UnknownFormatError) as refused:
            format_of("part.dwg")
        assert ("step" in str(refused.value)) == installed
        Path("empty").mkdir(exist_ok=True)
        assert ("step" in run("ingest", "empty").stderr) == installed


def test_results_show_digits_near_one(archive: Client, cup: Path, run: Run) -> None:
    archive.upload(cup)
    archive.upload(("pose.off", mesh_bytes("cup", 1)))
    done = run("query", cup, "--url", archive.url)
    shown = [line.split() for line in done.stdout.splitlines() if "pose.off" in line]
    (cc,) = {result.cc for result in archive.query_file(cup).results if result.shape.name == "pose.off"}
    assert any(word.startswith("0.") and abs(float(word) - cc) < 0.1 * (1.0 - cc) for word in shown[0])


def test_ctrl_c_ends_ingest_with_a_summary_and_it_goes_on(archive: Client, tmp_path: Path, run: Run) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    total = 25
    for number in range(total):
        (folder / f"{number}.off").write_bytes(small_file(number))
    command = [sys.executable, "-P", "-m", "service.cli", "ingest", str(folder), "--url", archive.url]
    slowly = ["--at-once", "1"]
    process = subprocess.Popen(
        [*command, *slowly], env=os.environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    wait_until(lambda: archive.page().total >= 3, seconds=120)
    process.send_signal(signal.SIGINT)
    out, said = process.communicate(timeout=60)
    assert process.returncode == 130
    stored = int(out.split()[0])
    assert out == f"{stored} stored, 0 already there, 0 refused\n"
    assert 3 <= stored + 1 <= archive.page().total + 1 < total
    assert said.splitlines()[-1] == (
        f"isoshape: stopped; {total - stored} of {total} left, and the same command continues"
    )
    assert "Traceback" not in said
    assert run("ingest", folder, "--url", archive.url).status == 0
    assert archive.page().total == total


@pytest.mark.parametrize("command", [["serve", "--port", "0"], ["reembed"], ["check"], ["query", "x.off"]])
def test_a_newer_archive_is_refused_with_a_clear_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run, command: list[str]
) -> None:
    path = tmp_path / "archive.sqlite3"
    Path("x.off").write_text("OFF", encoding="utf-8")
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", f"sqlite:///{path}")
    database = Database(f"sqlite:///{path}", lock_seconds=1)
    migrate(database)
    database.close()
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    before = path.read_bytes()
    done = run(*command)
    assert done.status == 1
    assert "9999" in done.stderr.splitlines()[-1]
    assert "newer" in done.stderr.splitlines()[-1]
    assert path.read_bytes() == before
