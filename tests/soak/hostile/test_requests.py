"""Hostile requests to a service that runs as a process of its own, many at a time."""

import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from http.client import BadStatusLine, HTTPResponse

import httpx
import pytest

from service.http.problem_document import MEDIA_TYPE
from tests.service.http.responsiveness import assert_others_are_served
from tests.service.support import small_file, upload
from tests.soak.hostile.conftest import Served
from tests.soak.hostile.raw_requests import Hostile, forms, headers, reads, stalls

SETTINGS = {"ISOSHAPE_RECEIVE_SECONDS": "2"}
AT_A_TIME, TRIES = 8, 100
# A service that closes the connection before it has read all of a request resets it: the answer may be lost.
READ_WHOLE_BYTES = 16 * 1024


def answer(client: httpx.Client, sent: bytes) -> HTTPResponse | None:
    """The answer to some bytes, if there is one."""
    url = client.base_url
    with socket.create_connection((url.host, url.port), timeout=60) as connection:
        with suppress(ConnectionError):
            connection.sendall(sent)
        with closing(HTTPResponse(connection)) as response, suppress(ConnectionError, BadStatusLine):
            response.begin()
            return response
    return None


def fault(client: httpx.Client, case: Hostile) -> str:
    """The fault of the answer to a request; "" if there is none."""
    given = answer(client, case.sent)
    for _ in range(TRIES):
        if given is None or given.status != 503 or not case.name.startswith("/jobs"):
            break
        # Two archives of a client arrive at a time.
        if given.getheader("retry-after") is None:
            return f"{case.name}: 503 without Retry-After"
        time.sleep(0.1)
        given = answer(client, case.sent)
    if given is None:
        return "" if len(case.sent) > READ_WHOLE_BYTES else f"{case.name}: no answer"
    if given.status not in case.statuses:
        return f"{case.name}: {given.status}, not one of {sorted(case.statuses)}"
    # The server answers what is not HTTP in plain text.
    forms = {MEDIA_TYPE, "text/plain; charset=utf-8"} if given.status == 400 else {MEDIA_TYPE}
    if given.status >= 400 and given.getheader("content-type") not in forms:
        return f"{case.name}: {given.status} without a problem document"
    return ""


@pytest.mark.parametrize("requests", [forms, headers, stalls, reads])
def test_each_is_answered_by_a_problem(served: Served, requests: Callable[[str], Iterator[Hostile]]) -> None:
    stored = upload(served.client, small_file(1), "stored.off")
    with ThreadPoolExecutor(AT_A_TIME) as threads:
        faults = threads.map(lambda case: fault(served.client, case), requests(stored.json()["id"]))
    assert [found for found in faults if found] == []
    assert upload(served.client, small_file(0), "after.off").status_code in {200, 201}


def test_others_are_served_meanwhile(served: Served) -> None:
    def load() -> None:
        for case in (*forms(""), *headers("")):
            answer(served.client, case.sent)

    assert_others_are_served(served.client, load)


def test_the_log_has_no_failure_of_the_service(served: Served) -> None:
    assert served.client.get("/readyz").status_code == 200
    text = (served.folder / "log.txt").read_text()
    # This Python may have known holes.
    lines = [line for line in text.splitlines() if not line.startswith("Warning: Python")]
    address = str(served.client.base_url).rstrip("/")
    assert lines[:2] == [f"Isoshape {state} on {address}" for state in ("starts", "listens")]
    assert [line for line in lines[2:] if not line.startswith("{") or '"level": "error"' in line] == []
