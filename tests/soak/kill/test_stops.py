"""Processes that are asked to stop, or killed, in the middle of their work."""

import os
import re
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from service.client import Client
from service.server.process import LOOPBACK, bind, wait_until_ready
from tests.service.cli.conftest import environment, run
from tests.service.cli.test_demo import free_port
from tests.service.cli.test_reembed import Run, archive_to_reembed, assert_goes_on
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


def test_reembed_stopped_and_killed_goes_on_and_does_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    few = archive_to_reembed(tmp_path, monkeypatch, 120)
    stops = ((signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9))
    assert_goes_on(tmp_path, few, run, *stops)
