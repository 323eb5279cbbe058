"""Hostile requests to a service that runs as a process of its own, many at a time."""

import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from service.http.problem_document import MEDIA_TYPE
from tests.service.http.responsiveness import assert_others_are_served
from tests.service.support import small_file, upload
from tests.soak.hostile.raw_requests import Hostile, forms, headers, reads, stalls
from tests.soak.hostile.serving import server

SECONDS, AT_A_TIME, TRIES = 2, 8, 100
# A service that closes the connection before it has read all of a request resets it: the answer may be lost.
READ_WHOLE_BYTES = 16 * 1024


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[httpx.Client, Path]]:
    """A service that waits two seconds for the next bytes, and its folder."""
    folder = tmp_path_factory.mktemp("requests")
    with server(folder, ISOSHAPE_RECEIVE_SECONDS=str(SECONDS)) as (_, client):
        yield client, folder


def answer(client: httpx.Client, sent: bytes) -> tuple[int, dict[str, str], bytes]:
    """The status, headers and body of the answer to some bytes; status 0 if there is none."""
    url = client.base_url
    with socket.create_connection((url.host, url.port)) as connection:
        connection.settimeout(60)
        received = b""
        try:
            connection.sendall(sent)
            while b"\r\n\r\n" not in received and (more := connection.recv(65536)):
                received += more
        except ConnectionError:
            # The service closed the connection before all was sent; what it answered may be lost.
            pass
    if b"\r\n\r\n" not in received:
        return 0, {}, received
    head, _, body = received.partition(b"\r\n\r\n")
    status, *lines = head.decode("latin-1").split("\r\n")
    return (
        int(status.split()[1]),
        {line.split(":")[0].lower(): line.split(":", 1)[1].strip() for line in lines},
        body,
    )


def fault(client: httpx.Client, case: Hostile) -> str:
    """What is wrong with the answer to a request; "" if nothing is."""
    status, given, _ = answer(client, case.sent)
    for _ in range(TRIES):
        if status != 503 or not case.name.startswith("/jobs"):
            break
        # Two archives of a client arrive at a time.
        if "retry-after" not in given:
            return f"{case.name}: 503 without Retry-After"
        time.sleep(0.1)
        status, given, _ = answer(client, case.sent)
    if status == 0 and (not case.statuses or len(case.sent) > READ_WHOLE_BYTES):
        return ""
    if status not in case.statuses:
        return f"{case.name}: {status}, not one of {sorted(case.statuses)}"
    # The server answers what is not HTTP in plain text.
    forms = {MEDIA_TYPE, "text/plain; charset=utf-8"} if status == 400 else {MEDIA_TYPE}
    if status >= 400 and given.get("content-type") not in forms:
        return f"{case.name}: {status} without a problem document"
    return ""


@pytest.mark.parametrize("kind", [forms, headers, stalls, reads])
def test_each_request_is_answered_by_a_problem(running: tuple[httpx.Client, Path], kind: object) -> None:
    client, _ = running
    stored = upload(client, small_file(1), "stored.off")
    cases = list(reads(stored.json()["id"]) if kind is reads else kind())  # type: ignore[operator]
    with ThreadPoolExecutor(AT_A_TIME) as threads:
        faults = [found for found in threads.map(lambda case: fault(client, case), cases) if found]
    assert faults == []
    assert upload(client, small_file(0), "after.off").status_code in {200, 201}


def test_others_are_served_meanwhile(running: tuple[httpx.Client, Path]) -> None:
    client, _ = running

    def load() -> None:
        for case in (*forms(), *headers()):
            answer(client, case.sent)

    assert_others_are_served(client, load)


def test_the_log_has_no_failure_of_the_service(running: tuple[httpx.Client, Path]) -> None:
    client, folder = running
    assert client.get("/readyz").status_code == 200
    lines = (folder / "log.txt").read_text().splitlines()
    assert lines[:2] == [
        f"Isoshape {state} on {client.base_url}".rstrip("/") for state in ("starts", "listens")
    ]
    assert [line for line in lines[2:] if not line.startswith("{") or '"level": "error"' in line] == []
