"""Clients that send the head of a request slowly, or hold connections without one."""

import resource
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack

import httpx
import pytest
from starlette.types import Receive, Scope, Send

from service.server.http_protocol import most_connections
from service.server.uvicorn_server import _config
from tests.service.support import Running, assert_problem, serving, settings_in, wait_until

SECONDS, CONNECTIONS = 1.0, 10


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service with a second for each head, and ten connections."""
    settings = settings_in(tmp_path_factory.mktemp("slow"), receive_seconds=SECONDS)
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


def test_no_client_names_its_own_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORWARDED_ALLOW_IPS", raising=False)
    assert not _config(_nothing, 1, 1.0).proxy_headers
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "10.0.0.1")
    assert _config(_nothing, 1, 1.0).proxy_headers


async def _nothing(_scope: Scope, _receive: Receive, _send: Send) -> None:
    """Answer nothing."""


def connected(running: Running) -> socket.socket:
    url = running.client.base_url
    connection = socket.create_connection((url.host, url.port))
    connection.settimeout(20)
    return connection


def everything(connection: socket.socket) -> bytes:
    """What arrives until the service closes the connection."""
    received = b""
    while part := connection.recv(65536):
        received += part
    return received


def problem(received: bytes) -> httpx.Response:
    head, _, body = received.partition(b"\r\n\r\n")
    status, *lines = head.decode().split("\r\n")
    headers = dict(line.lower().split(": ", 1) for line in lines)
    assert headers["connection"] == "close"
    return httpx.Response(int(status.split()[1]), headers=headers, content=body)


def test_a_head_that_stops_is_given_up(running: Running) -> None:
    start = time.monotonic()
    with connected(running) as connection:
        connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX-Slow: ")
        assert_problem(problem(everything(connection)), 408, "request-timeout")
    assert SECONDS - 0.1 <= time.monotonic() - start < 10


def test_a_head_of_one_byte_at_a_time_is_given_up(running: Running) -> None:
    start = time.monotonic()
    with connected(running) as connection:
        connection.sendall(b"GET /healthz HTTP/1.1\r\n")
        connection.setblocking(False)
        received = b""
        while not received and time.monotonic() < start + 10:
            time.sleep(0.1)
            try:
                connection.sendall(b"x")
                received = connection.recv(4096)
            except BlockingIOError:
                pass
            except ConnectionError:
                break
    assert time.monotonic() - start < 5


def test_a_connection_without_a_request_is_closed(running: Running) -> None:
    with connected(running) as connection:
        assert everything(connection) == b""


def test_the_second_head_of_a_connection_has_its_time_as_well(running: Running) -> None:
    request = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with connected(running) as connection:
        for _ in range(2):
            connection.sendall(request)
            received = b""
            while not received.endswith(b"}"):
                received += connection.recv(65536)
            assert received.startswith(b"HTTP/1.1 200")
            # Longer than a head may take: the connection is kept for the next request.
            time.sleep(1.5 * SECONDS)
        connection.sendall(request[:20])
        assert_problem(problem(everything(connection)), 408, "request-timeout")


@pytest.mark.parametrize(
    "sent", [b"\x16\x03\x01 no HTTP\r\n\r\n", b"GET  HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n"]
)
def test_a_request_that_is_none_has_a_problem_for_an_answer(running: Running, sent: bytes) -> None:
    with connected(running) as connection:
        connection.sendall(sent)
        assert_problem(problem(everything(connection)), 400, "bad-request")


def test_the_rest_of_a_body_is_no_head_of_a_request(running: Running) -> None:
    """The answer came before the body."""
    head = b"POST /nothing HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\n"
    with connected(running) as connection:
        connection.sendall(head)
        received = b""
        while b"not-found" not in received:
            received += connection.recv(65536)
        connection.sendall(b"x" * 500)
        time.sleep(0.1)
        connection.sendall(b"x" * 500)
        assert b"408" not in everything(connection)
    with connected(running) as connection:
        connection.sendall(
            head + b"x" * 1000 + b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        )
        assert b"HTTP/1.1 200" in everything(connection)


@pytest.mark.parametrize("path", ["/shapes", "/nothing"])
def test_a_chunk_that_is_none_has_a_problem_for_an_answer(
    running: Running, caplog: pytest.LogCaptureFixture, path: str
) -> None:
    """The application answers the same request too, because the body does not matter to it."""
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
    with connected(running) as connection:
        connection.sendall(head.encode() + b"x\r\n")
        assert_problem(problem(everything(connection)), 400, "bad-request")
    wait_until(lambda: not running.server.server_state.tasks, seconds=5)
    assert [record for record in caplog.records if record.levelname == "ERROR"] == []


def slow_reader(running: Running, *, answers: int = 1) -> socket.socket:
    """A connection that has asked for answers of 300 kB and has read none of them."""
    url = running.client.base_url
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.connect((url.host, url.port))
    connection.settimeout(20)
    connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * answers)
    return connection


def test_an_answer_that_nobody_reads_is_given_up(running: Running) -> None:
    connections = running.server.server_state.connections
    wait_until(lambda: not connections, seconds=10)
    # More than the kernel takes.
    with slow_reader(running, answers=50):
        wait_until(lambda: connections, seconds=5)
        wait_until(lambda: not connections, seconds=10 * SECONDS)


def test_an_answer_that_is_being_read_does_not_give_way(running: Running) -> None:
    with ExitStack() as stack:
        reader = stack.enter_context(slow_reader(running))
        wait_until(
            lambda: any(each.flow.write_paused for each in running.server.server_state.connections), seconds=5
        )
        for _ in range(2 * CONNECTIONS):
            stack.enter_context(connected(running))
        head, _, body = everything(reader).partition(b"\r\n\r\n")
        assert f"content-length: {len(body)}\r\n".encode() in head.lower()


def test_idle_connections_give_way_to_new_ones(running: Running) -> None:
    """Eight times as many as there may be: the last has an answer, and the first are closed."""
    with ExitStack() as stack:
        idle = [stack.enter_context(connected(running)) for _ in range(8 * CONNECTIONS)]
        with connected(running) as last:
            last.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            assert everything(last).startswith(b"HTTP/1.1 200")
        wait_until(lambda: len(running.server.server_state.connections) <= CONNECTIONS, seconds=5)
        assert everything(idle[0]) == b""
