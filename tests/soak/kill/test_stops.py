"""Processes that are asked to stop, or killed, in the middle of their work."""

import os
import re
import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import httpx
import pytest

from core.parameters import DEFAULT
from service.client import Client
from service.server.process import LOOPBACK, bind, wait_until_ready
from tests.service.cli.conftest import Run, environment, run
from tests.service.cli.test_reembed import archive_to_reembed
from tests.service.cli.test_server import free_port
from tests.service.pipeline_files import active, embeddings
from tests.service.processes import server
from tests.service.support import assert_problem, small_file, upload, wait_until

__all__ = ["environment", "run"]


def test_a_signal_drops_no_request(tmp_path: Path) -> None:
    settings = {"ISOSHAPE_SHUTDOWN_SECONDS": "1"}
    requests = 12

    def inside(client: httpx.Client) -> float:
        (line,) = re.findall(r"^isoshape_queue_requests (\S+)$", client.get("/metrics").text, re.M)
        return float(line)

    with server(tmp_path, **settings) as (process, client), ThreadPoolExecutor(requests) as others:
        sent = [
            others.submit(upload, client, small_file(number), f"{number}.off") for number in range(requests)
        ]
        wait_until(lambda: inside(client) + sum(each.done() for each in sent) >= requests, seconds=60)
        process.send_signal(signal.SIGTERM)
        answers = [each.result() for each in sent]
        assert process.wait(timeout=60) in {0, -signal.SIGTERM}
    acknowledged = {answer.json()["id"] for answer in answers if answer.status_code == 201}
    for answer in answers:
        if answer.status_code != 201:
            assert_problem(answer, 503, "shutting-down")
    with server(tmp_path, **settings) as (_, client):
        assert acknowledged <= {shape["id"] for shape in client.get("/shapes").json()["shapes"]}


def test_sigterm_to_the_demonstration_ends_its_service_too() -> None:
    port = free_port()
    command = [sys.executable, "-P", "-m", "service.cli", "demo", "--port", str(port)]
    process = subprocess.Popen(command, env={**os.environ, "ISOSHAPE_LOG_LEVEL": "error"})
    try:
        with Client(f"http://{LOOPBACK}:{port}") as client:
            wait_until_ready(client, ended=lambda: process.poll() is not None)
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 128 + signal.SIGTERM
    finally:
        process.kill()
        process.wait()
    bind(LOOPBACK, port).close()


def interrupted(folder: Path, enough: int, number: signal.Signals) -> tuple[int, str]:
    """Run the command until there are so many embeddings, and stop it: status, and what it said."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "service.cli", "reembed"],
        env=os.environ | {"ISOSHAPE_WORKERS": "1"},
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until(lambda: len(embeddings(folder)) >= enough or process.poll() is not None, seconds=180)
    assert process.poll() is None
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    return process.returncode, said


def test_reembed_stopped_and_killed_goes_on_and_does_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    stored = 60
    few = archive_to_reembed(tmp_path, monkeypatch, stored)
    done: list[tuple[int, str]] = []
    for number, status in ((signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)):
        returned, said = interrupted(tmp_path, len(done) + 2, number)
        assert returned == status
        assert ("the same command continues" in said) == (number != signal.SIGKILL)
        before, done = done, embeddings(tmp_path)
        assert done[: len(before)] == before
        assert len(before) + 2 <= len(done) < stored
        assert active(tmp_path) == DEFAULT.fingerprint
    finished = run("reembed")
    left = stored - len(done)
    assert (finished.status, finished.stdout) == (
        0,
        f"{left} embedded by pipeline few ({few.fingerprint}), the archive is searched by it\n",
    )
    assert f"{left} of {left} embedded" in finished.stderr
    assert embeddings(tmp_path)[: len(done)] == done
    assert [fingerprint for _, fingerprint in embeddings(tmp_path)] == [few.fingerprint] * stored
    assert active(tmp_path) == few.fingerprint
    with closing(sqlite3.connect(tmp_path / "archive.sqlite3")) as connection:
        assert connection.execute("SELECT count(*) FROM shapes WHERE facts = '{}'").fetchone() == (0,)
