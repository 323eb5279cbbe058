"""Bodies that stop arriving: they take room of their own client only, and are given up after some seconds."""

import asyncio
import errno
import select
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import Any

import httpx
import pytest
from starlette import formparsers

from service.auth.keys import digest_of
from service.search import endpoints as search_endpoints
from tests.service.http.responsiveness import assert_others_are_served
from tests.service.support import (
    Running,
    assert_problem,
    module_service,
    serving,
    settings_in,
    small_file,
    upload,
    wait_until,
)

FULL, READ = "isoshape_full", "isoshape_read"
SECONDS = 2.0
SLOTS = 4
MB = 1_000_000


LIMITS = {"queue_length": SLOTS - 1, "api_keys": (digest_of(FULL),), "read_keys": (digest_of(READ),)}
running = module_service(key=FULL, receive_seconds=SECONDS, **LIMITS)
patient = module_service(key=FULL, receive_seconds=600.0, **LIMITS)
"""A service that gives no body up while a test runs."""


class Folder:
    """A temporary folder with little room, and the files that are in it."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.files: dict[int, int] = {}

    @property
    def free(self) -> int:
        return self.room - sum(self.files.values())


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Folder:
    """A temporary folder of 30 MB, as a container may have it."""
    made = Folder(30 * MB)

    class Spooled(SpooledTemporaryFile[bytes]):
        def write(self, data: Any) -> int:
            written = super().write(data)
            if self._rolled:  # type: ignore[attr-defined]
                if len(data) > made.free:
                    raise OSError(errno.ENOSPC, "no space left on device")
                made.files[id(self)] = self.tell()
            return written

        def close(self) -> None:
            made.files.pop(id(self), None)
            super().close()

    monkeypatch.setattr(formparsers, "SpooledTemporaryFile", Spooled)
    usage = shutil.disk_usage("/")
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=made.free))
    return made


def connected(running: Running, request: str, key: str, *headers: str, body: bytes = b"") -> socket.socket:
    """A connection on which the head of a request has been sent, and the beginning of its body."""
    url = running.client.base_url
    connection = socket.create_connection((url.host, url.port), timeout=60)
    lines = [f"{request} HTTP/1.1", "Host: localhost", f"X-API-Key: {key}", *headers, "", ""]
    connection.sendall("\r\n".join(lines).encode() + body)
    return connection


def begin(
    running: Running, path: str, length: int, sent: int, *, key: str = READ, name: str = "a.off"
) -> socket.socket:
    """A connection on which a form with a file has begun to arrive, unless it is refused meanwhile."""
    head = f'--b\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
    headers = "Content-Type: multipart/form-data; boundary=b", f"Content-Length: {length}"
    connection = connected(running, f"POST {path}", key, *headers, body=head.encode())
    with suppress(ConnectionError):
        for start in range(0, sent, 65536):
            connection.sendall(b"x" * min(65536, sent - start))
    return connection


def answer(connection: socket.socket) -> httpx.Response:
    """The answer on a connection, which the service then closes."""
    connection.settimeout(30)
    received = b""
    while part := connection.recv(65536):
        received += part
    head, _, body = received.partition(b"\r\n\r\n")
    status, *lines = head.decode().split("\r\n")
    headers = dict(line.lower().split(": ", 1) for line in lines)
    assert headers["connection"] == "close"
    return httpx.Response(int(status.split()[1]), headers=headers, content=body)


@pytest.mark.parametrize(("path", "sent"), [("/query", 0), ("/shapes", 2 * MB), ("/jobs", 100_000)])
def test_a_body_that_stops_is_given_up(running: Running, path: str, sent: int) -> None:
    start = time.monotonic()
    with begin(running, path, 4 * MB, sent, key=FULL) as connection:
        assert_problem(answer(connection), 408, "request-timeout")
    assert time.monotonic() - start >= SECONDS - 0.1


@pytest.mark.parametrize("length", [100, 60_000])
def test_json_that_stops_is_given_up(running: Running, length: int) -> None:
    headers = "Content-Type: application/json", f"Content-Length: {length}"
    with connected(running, "POST /compare", READ, *headers, body=b'{"first": ') as connection:
        assert_problem(answer(connection), 408, "request-timeout")


def test_a_slow_body_that_goes_on_is_taken(running: Running) -> None:
    data = small_file(3) + b"\n" * 200_000

    def slowly() -> Iterator[bytes]:
        yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="slow.off"\r\n\r\n'
        for start in range(0, len(data), len(data) // 5 + 1):
            time.sleep(SECONDS / 4)
            yield data[start : start + len(data) // 5 + 1]
        yield b"\r\n--b--\r\n"

    headers = {"content-type": "multipart/form-data; boundary=b"}
    assert running.client.post("/shapes", content=slowly(), headers=headers).status_code == 201


def test_a_body_of_a_few_bytes_at_a_time_is_given_up(running: Running) -> None:
    with begin(running, "/query", 4 * MB, 0) as connection:
        start = time.monotonic()
        while not select.select([connection], [], [], SECONDS / 10)[0]:
            connection.sendall(b"x")
            assert time.monotonic() - start < 30 * SECONDS
        assert_problem(answer(connection), 408, "request-timeout")


@pytest.mark.parametrize(
    ("header", "chunks", "status", "kind"),
    [
        ("Content-Length: 5", 0, 408, "request-timeout"),
        ("Transfer-Encoding: chunked", 1, 408, "request-timeout"),
        ("Transfer-Encoding: chunked", 20, 413, "body-too-large"),
    ],
)
def test_a_body_that_is_refused_while_a_query_runs_is_a_problem(
    running: Running, monkeypatch: pytest.MonkeyPatch, header: str, chunks: int, status: int, kind: str
) -> None:
    """A GET has no use for a body, but may have one."""
    shape = running.store(small_file(1))["id"]

    async def slow(*_arguments: object) -> None:
        await asyncio.sleep(60)

    monkeypatch.setattr(search_endpoints, "with_active_pipeline", slow)
    body = (b"1000\r\n" + b"x" * 4096 + b"\r\n") * chunks
    with connected(running, f"GET /shapes/{shape}/similar", READ, header, body=body) as connection:
        assert_problem(answer(connection), status, kind)


def test_stalled_bodies_of_one_key_leave_room_for_others(patient: Running, folder: Folder) -> None:
    """Three bodies of 9.3 MB would fill the folder."""
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(begin(patient, "/query", 9_400_000, 9_300_000))
        wait_until(lambda: folder.free < 21 * MB, seconds=60)
        large = small_file(5) + b"\n" * 9 * MB
        assert upload(patient.client, large, "large.off").status_code == 201
    wait_until(lambda: folder.free == folder.room, seconds=60)


def test_stalled_bodies_delay_nobody(running: Running) -> None:
    def stall() -> None:
        with ExitStack() as stack:
            for _ in range(SLOTS + 2):
                stack.enter_context(begin(running, "/query", 9_400_000, 2_000_000))
            time.sleep(SECONDS / 2)

    assert_others_are_served(running.client, stall)


def test_a_client_that_fills_its_room_is_told_so(patient: Running, folder: Folder) -> None:
    with begin(patient, "/query", 29 * MB, 5 * MB), begin(patient, "/query", 20 * MB, 1 * MB) as second:
        # A piece at a time: an answer is lost if more of the body arrives after it.
        while not select.select([second], [], [], 0.02)[0]:
            second.sendall(b"x" * 65536)
        problem = assert_problem(answer(second), 507, "storage-full")
        assert "temporary folder" in problem["detail"]
        assert folder.free >= 2 * folder.room / 3


def test_a_client_has_so_many_bodies_and_takes_none_of_others(patient: Running) -> None:
    with ExitStack() as stack:
        for _ in range(SLOTS):
            stack.enter_context(begin(patient, "/query", 100_000, 50))
        own = {"authorization": f"Bearer {READ}"}
        file = {"file": ("a.off", small_file(1))}

        def refused() -> bool:
            return patient.client.post("/query", files=file, headers=own).status_code == 503

        wait_until(refused, seconds=60)
        assert_problem(patient.client.post("/query", files=file, headers=own), 503, "busy")
        assert patient.client.get("/shapes", headers=own).status_code == 200
        assert patient.client.post("/query", files=file).status_code == 200
    wait_until(lambda: not refused(), seconds=60)


def test_stalled_archives_of_one_key_leave_places_for_others(tmp_path: Path) -> None:
    other = "isoshape_other"
    settings = settings_in(tmp_path, workers=1, api_keys=(digest_of(FULL), digest_of(other)))
    with serving(settings, ready=False, key=other) as running, ExitStack() as stack:
        file = {"file": ("a.zip", b"PK")}
        own = {"authorization": f"Bearer {FULL}"}

        def refused() -> bool:
            stack.enter_context(begin(running, "/jobs", 2 * MB, 100, key=FULL, name="a.zip"))
            return running.client.post("/jobs", files=file, headers=own).status_code == 503

        wait_until(refused, seconds=60)
        assert_problem(running.client.post("/jobs", files=file), 415, "unknown-archive")


@pytest.mark.parametrize(
    ("path", "key", "status"),
    [("/nothing", FULL, 404), ("/shapes", READ, 403), ("/shapes", "none", 401), ("/shapes/x", FULL, 405)],
)
def test_an_endless_body_that_nobody_reads_ends_with_the_answer(
    running: Running, path: str, key: str, status: int
) -> None:
    sent = 0
    with connected(running, f"POST {path}", key, "Transfer-Encoding: chunked") as connection:
        connection.settimeout(20)
        assert int(connection.recv(64).split()[1]) == status
        with suppress(OSError):
            while sent < 50 * MB:
                connection.sendall(b"10000\r\n" + b"x" * 65536 + b"\r\n")
                sent += 65536
    assert sent < 10 * MB


def test_a_body_of_two_lengths_ends_the_connection(running: Running) -> None:
    """What follows may be a request that a proxy has not seen (RFC 9112, section 6.3)."""
    smuggled = b"0\r\n\r\nGET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"
    both = "Content-Length: 5", "Transfer-Encoding: chunked"
    with connected(running, "POST /nothing", FULL, *both, body=smuggled) as connection:
        connection.settimeout(20)
        received = b"".join(iter(lambda: connection.recv(65536), b""))
    assert received.count(b"HTTP/1.1 ") == 1
    assert b"connection: close" in received.lower()
