"""A server process that is asked to stop while many requests wait."""

import re
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx

from tests.service.processes import server
from tests.service.support import assert_problem, small_file, upload, wait_until


def test_a_signal_drops_no_request(tmp_path: Path) -> None:
    settings = {"ISOSHAPE_WORKERS": "1", "ISOSHAPE_SHUTDOWN_SECONDS": "1"}
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
