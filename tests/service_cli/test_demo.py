"""`isoshape demo`, with a smaller gallery, and `isoshape openapi`."""

import json
import socket
from pathlib import Path

import pytest

from service import openapi
from service.cli import demo
from service.cli.server import LOOPBACK
from tests.service_cli.conftest import CLASSES, Run


def free_port() -> int:
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        return int(free.getsockname()[1])


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "CLASSES", CLASSES)
    monkeypatch.setattr(demo, "POSES", 3)


@pytest.mark.usefixtures("small")
def test_check_twice_then_with_a_wrong_archive(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(2):
        done = run("demo", "--check", "--port", free_port())
        assert (done.status, done.stderr.splitlines()[-1]) == (
            0,
            "3 of 3 first neighbours are of the query's class",
        )
        rows = [line.split() for line in done.stdout.splitlines()]
        first = [row for row in rows if len(row) == 7 and row[1] == "1"]
        assert [row[0] for row in first] == [f"{label}-03.ply" for label in CLASSES]
        assert all(
            row[2].startswith(label) and row[6] == "same" for row, label in zip(first, CLASSES, strict=True)
        )
        assert len([row for row in rows if row and row[-1] in {"same", "other"}]) == 9
    assert Path("isoshape-data/demo.sqlite3").is_file()

    # The archive now holds every query itself, under another class.
    shape = demo._shape
    monkeypatch.setattr(demo, "CLASSES", ("cup", "pliers"))
    monkeypatch.setattr(demo, "FOLDER", Path("mixed"))
    monkeypatch.setattr(
        demo, "_shape", lambda label, pose: shape("pliers" if (label, pose) == ("cup", 3) else label, pose)
    )
    done = run("demo", "--check", "--port", free_port())
    assert done.status == 1
    assert done.stderr.splitlines()[-1].endswith("of another class for pliers-03.ply")


def test_a_taken_port(run: Run) -> None:
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = run("demo", "--check", "--port", port)
    assert done.status == 2
    assert done.stderr == (
        f"isoshape: cannot listen on 127.0.0.1 port {port}: Address already in use; "
        "choose another with --port\n"
    )
    assert not Path("isoshape-data").exists()


def test_openapi_to_a_file_and_to_standard_output(run: Run) -> None:
    assert run("openapi").status == 0
    written = Path("openapi/openapi.json").read_text(encoding="utf-8")
    assert json.loads(written) == openapi.document()
    assert run("openapi", "--output", "-").stdout == written
