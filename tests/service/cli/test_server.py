"""Running the service: in a thread, and as a process of its own."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from core.parameters import DEFAULT
from service.app import create_app
from service.client import Client
from service.compute.compilation import compile_kernels
from service.server.process import LOOPBACK, PortError, StartError, bind, wait_until_ready
from service.server.uvicorn_server import in_thread
from service.settings import Settings
from tests.service.cli.conftest import Run, mesh_bytes


def free_port() -> int:
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        return int(free.getsockname()[1])


def test_a_taken_port_is_named() -> None:
    with bind(LOOPBACK, 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(PortError, match=f"port {port}"):
            bind(LOOPBACK, port)
    bind(LOOPBACK, port).close()


@pytest.mark.parametrize(
    ("command", "advice"), [(["serve"], ""), (["demo", "--check"], "; choose another with --port")]
)
def test_commands_on_a_taken_port(run: Run, command: list[str], advice: str) -> None:
    with bind(LOOPBACK, 0) as taken:
        port = taken.getsockname()[1]
        done = run(*command, "--port", port)
    assert done.status == 2
    assert done.stderr == (
        f"isoshape: cannot listen on 127.0.0.1 port {port}: Address already in use{advice}\n"
    )
    assert not Path("isoshape-data").exists()


def test_a_host_of_another_machine_is_named() -> None:
    with pytest.raises(PortError, match=r"192\.0\.2\.1"):
        bind("192.0.2.1", 0)


def test_a_service_that_cannot_start_says_why(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    settings = Settings(database_url=f"sqlite:///{tmp_path}/file/archive.sqlite3", workers=1)
    with pytest.raises(StartError, match=r"could not start: .*folder"), in_thread(create_app(settings)):
        pytest.fail("it started")


def test_serve_until_a_signal_and_again() -> None:
    compile_kernels(DEFAULT)
    environment = {**os.environ, "ISOSHAPE_LOG_LEVEL": "error"}
    port = free_port()
    command = [sys.executable, "-P", "-m", "service.cli", "serve", "--port", str(port)]
    names = []
    for sent, status in ((signal.SIGINT, 0), (signal.SIGTERM, -signal.SIGTERM)):
        process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        try:
            with Client(f"http://{LOOPBACK}:{port}") as client:
                wait_until_ready(client, ended=lambda process=process: process.poll() is not None)
                assert process.stderr is not None
                told = (line.rstrip() for line in process.stderr if not line.startswith("Warning: Python"))
                messages = [next(told) for _ in range(2)]
                client.upload((f"{len(names)}.off", mesh_bytes("cup", 0)))
                names = [shape.name for shape in client.shapes()]
            process.send_signal(sent)
            _, last = process.communicate(timeout=60)
        finally:
            process.kill()
            process.wait()
        assert process.returncode == status
        url = f"http://{LOOPBACK}:{port}"
        assert messages == [f"Isoshape starts on {url}", f"Isoshape listens on {url}"]
        assert not last
    assert names == ["0.off", "1.off"]
    assert Path("isoshape-data/isoshape.sqlite3").is_file()
