"""The server: its limits on connections, requests that are not HTTP, and the memory that it returns."""

import os
import resource
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from starlette.types import Receive, Scope, Send

from service.server.uvicorn_server import HEAPS, KEPT_BYTES, config, most_connections
from tests.service.support import Running, serving, settings_in, wait_until

CONNECTIONS = 10
HEALTH = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"

THREADS = 4
PROGRAM = f"""
import threading
from pathlib import Path
from service.server.uvicorn_server import return_freed_memory

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * {os.sysconf("SC_PAGE_SIZE")}

def receive_files():
    together.wait()
    for size in (8, 16, 24, 24):
        file, copy = b"x" * (size << 20), b"y" * (size << 18)
        del file, copy

{{first}}
together = threading.Barrier({THREADS})
before = resident()
threads = [threading.Thread(target=receive_files) for _ in range({THREADS})]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(resident() - before)
"""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service with ten connections."""
    settings = settings_in(tmp_path_factory.mktemp("server"))
    with serving(settings, ready=False, connections=CONNECTIONS) as running:
        yield running


@pytest.mark.parametrize(
    ("descriptors", "most"), [(resource.RLIM_INFINITY, 32752), (2**40, 32752), (1024, 496), (16, 8)]
)
def test_the_number_of_connections_has_a_bound(
    monkeypatch: pytest.MonkeyPatch, descriptors: int, most: int
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _kind: (descriptors, descriptors))
    assert most_connections() == most
    assert config(_nothing).limit_concurrency == most


def test_no_client_names_its_own_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORWARDED_ALLOW_IPS", raising=False)
    assert not config(_nothing).proxy_headers
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "10.0.0.1")
    assert config(_nothing).proxy_headers


async def _nothing(_scope: Scope, _receive: Receive, _send: Send) -> None:
    """Answer nothing."""


def connected(running: Running) -> socket.socket:
    url = running.client.base_url
    return socket.create_connection((url.host, url.port), timeout=20)


def everything(connection: socket.socket) -> bytes:
    """Return all bytes that arrive until the service closes the connection."""
    received = b""
    while part := connection.recv(65536):
        received += part
    return received


def test_connections_beyond_the_limit_are_answered_503(running: Running) -> None:
    connections = running.server.server_state.connections
    with ExitStack() as stack:
        for _ in range(CONNECTIONS):
            stack.enter_context(connected(running))
        with connected(running) as last:
            last.sendall(HEALTH)
            assert everything(last).startswith(b"HTTP/1.1 503")
    wait_until(lambda: not connections, seconds=10)
    with connected(running) as last:
        last.sendall(HEALTH)
        assert everything(last).startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(
    "sent",
    [
        b"\x16\x03\x01 no HTTP\r\n\r\n",
        b"GET  HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Long: " + b"x" * 70_000,
        b"POST /shapes HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nx\r\n",
        b"POST /nothing HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nx\r\n",
    ],
)
def test_a_request_that_is_not_http_is_answered_400(
    running: Running, caplog: pytest.LogCaptureFixture, sent: bytes
) -> None:
    """The application answers the last two as well, because it does not read their bodies."""
    with connected(running) as connection:
        connection.sendall(sent)
        assert everything(connection).startswith(b"HTTP/1.1 400")
    wait_until(lambda: not running.server.server_state.tasks, seconds=5)
    assert [record for record in caplog.records if record.levelname == "ERROR"] == []


def test_the_rest_of_a_body_is_no_head_of_a_request(running: Running) -> None:
    """The answer comes before the body."""
    head = b"POST /nothing HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\n"
    with connected(running) as connection:
        connection.sendall(head + b"x" * 1000 + HEALTH)
        received = everything(connection)
        assert received.startswith(b"HTTP/1.1 404")
        assert b"HTTP/1.1 200" in received


def kept(first: str) -> int:
    """Return the bytes that a process keeps after its threads freed large blocks."""
    program = PROGRAM.format(first=first)
    return int(subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have another allocator")
def test_each_heap_keeps_little_of_the_memory_of_large_files() -> None:
    assert kept("return_freed_memory()") <= HEAPS * KEPT_BYTES < kept("")
