"""`isoshape serve` as a process of its own, which tests may kill."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import psutil

from tests.service.engines import url_in
from tests.service.support import wait_until


@contextmanager
def server(
    folder: Path, *, seconds: float = 180, answer_seconds: float = 120, shared: bool = False, **settings: str
) -> Iterator[tuple[subprocess.Popen[bytes], httpx.Client]]:
    """`isoshape serve` on a folder's archive, ready in some seconds; killed at the end if it still runs.

    It has one worker unless the settings say otherwise; `shared` starts it beside another service.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("ISOSHAPE_")} | {
        "ISOSHAPE_DATABASE_URL": url_in(folder),
        "ISOSHAPE_JOB_FOLDER": str(folder / "jobs"),
        "ISOSHAPE_WORKERS": "1",
        **settings,
    }
    command = [sys.executable, "-P", "-m", "service.cli", "serve", "--port", str(port)]
    command += ["--shared"] if shared else []
    with (folder / "log.txt").open("ab") as log:
        process = subprocess.Popen(command, env=environment, cwd=folder, stdout=log, stderr=log)
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=answer_seconds) as client:
            wait_until(lambda: answers(client) or process.poll() is not None, seconds=seconds)
            assert process.poll() is None, f"the service ended: {(folder / 'log.txt').read_text()}"
            yield process, client
    finally:
        process.kill()
        process.wait()


def answers(client: httpx.Client) -> bool:
    """Whether the service is ready."""
    try:
        return client.get("/readyz").status_code == 200
    except httpx.TransportError:
        return False


def children(pid: int) -> list[int]:
    """The processes below a process: the fork server of a service, and its workers and readers."""
    return [child.pid for child in psutil.Process(pid).children(recursive=True)]


def runs(pid: int) -> bool:
    """Whether a process runs; one that has ended may still be listed until somebody asks how it ended."""
    try:
        return psutil.Process(pid).status() not in {psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD}
    except psutil.NoSuchProcess:
        return False
