"""Clients that go away, and a service that is asked to stop: what becomes of what is at work then."""

import socket
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest

from core.arrays import Float32s
from core.embedding import Scores
from core.matching.match_records import score_match_records
from core.parameters import Parameters
from service.compute import request_queue as work_module
from service.compute import tasks
from service.search import scoring
from service.shapes import service as shapes_service
from tests.service.support import (
    Running,
    assert_problem,
    module_service,
    query,
    serving,
    settings_in,
    small_file,
    upload,
    wait_until,
)
from tests.service.tasks import meet, nap_instead, napping

single = module_service(queue_length=1, task_seconds=600, log_level="info", stored={"first": small_file(0)})
"""A service with one worker, and room for one more request, that gives a task ten minutes."""


def file_form(data: bytes, name: str) -> dict[str, Any]:
    return {"files": {"file": (name, data)}}


def send(
    running: Running, path: str, *, method: str = "POST", part: float = 1.0, **body: Any
) -> socket.socket:
    """A connection on which a request, or the beginning of one, has been sent."""
    request = running.client.build_request(method, path, **body)
    head = "".join(f"{name}: {value}\r\n" for name, value in request.headers.items())
    content = request.read()
    url = running.client.base_url
    connection = socket.create_connection((url.host, url.port), timeout=60)
    connection.sendall(f"{method} {path} HTTP/1.1\r\n{head}\r\n".encode())
    connection.sendall(content[: round(part * len(content))])
    return connection


def names(running: Running) -> list[str]:
    return [shape["name"] for shape in running.client.get("/shapes").json()["shapes"]]


@pytest.mark.parametrize(
    ("task", "path"),
    [
        ("embed_mesh", "/shapes"),
        ("embed_mesh", "/query"),
        ("match_embeddings", "/compare"),
        ("dense_correspondence", "/compare?dense=true"),
    ],
)
def test_the_work_of_a_client_that_goes_away_is_stopped(
    single: Running, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, task: str, path: str
) -> None:
    pool, work = single.container.pool, single.container.queue
    (first,) = single.client.get("/shapes", params={"name": "first"}).json()["shapes"]
    body = {
        "embed_mesh": file_form(small_file(1), "gone.off"),
        "match_embeddings": {"json": {"first": first["id"], "second": first["id"]}},
        "dense_correspondence": {"json": {"first": first["id"], "second": first["id"]}},
    }[task]
    module = work_module if task == "embed_mesh" else tasks
    wait_until(pool.pids, seconds=60)
    before = pool.pids()
    with monkeypatch.context() as patch:
        patch.setattr(module, task, nap_instead)
        with send(single, path, **body):
            wait_until(lambda: napping(pool), seconds=60)
        wait_until(lambda: not work.inside, seconds=5)
        # The process has ten minutes for a task, and is replaced long before.
        wait_until(lambda: pool.pids() not in ([], before), seconds=60)
    wait_until(lambda: "the client went away" in caplog.messages, seconds=5)
    wait_until(
        lambda: any(getattr(each, "fields", {}).get("status") == 499 for each in caplog.records), seconds=5
    )
    assert "gone.off" not in names(single)
    assert single.client.post(path, **body).status_code in {200, 201}
    for shape in single.client.get("/shapes", params={"name": "gone"}).json()["shapes"]:
        single.client.delete(f"/shapes/{shape['id']}")


def test_a_client_that_goes_away_is_compared_no_further(
    single: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    (first,) = single.client.get("/shapes", params={"name": "first"}).json()["shapes"]
    numbers = [single.store(small_file(10 + i), name=f"more {i}")["id"] for i in range(8)]
    compared = []

    def slowly(query: Float32s, rows: Sequence[Float32s], parameters: Parameters) -> Scores:
        compared.append(len(rows))
        time.sleep(0.3)
        return score_match_records(query, rows, parameters)

    with monkeypatch.context() as patch:
        patch.setattr(scoring, "MATCH_BATCH", 1)
        patch.setattr(scoring, "score_match_records", slowly)
        with send(single, "/query", json={"shape_id": first["id"]}):
            wait_until(lambda: compared, seconds=60)
        wait_until(lambda: not single.container.queue.inside, seconds=5)
        time.sleep(1.0)
        assert 0 < len(compared) < 8
    for number in numbers:
        single.client.delete(f"/shapes/{number}")


def test_a_client_that_goes_away_while_it_waits_leaves_the_queue(
    single: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    pool, work = single.container.pool, single.container.queue
    with monkeypatch.context() as patch:
        patch.setattr(work_module, "embed_mesh", nap_instead)
        with send(single, "/query", **file_form(small_file(2), "works.off")):
            wait_until(lambda: napping(pool), seconds=60)
            for number in (3, 4):
                with send(single, "/shapes", **file_form(small_file(number), "waits.off")):
                    wait_until(lambda: work.inside == 2, seconds=10)
                    assert_problem(query(single.client, small_file(0)), 503, "busy")
                wait_until(lambda: work.inside == 1, seconds=5)
    wait_until(lambda: not work.inside, seconds=5)
    assert upload(single.client, small_file(5), "after.off").status_code == 201
    assert "waits.off" not in names(single)


def test_a_write_that_has_begun_is_whole(single: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    store = shapes_service._store
    begun, go_on, done = threading.Event(), threading.Event(), threading.Event()

    def slow(*arguments: Any) -> Any:
        begun.set()
        assert go_on.wait(60)
        stored = store(*arguments)
        done.set()
        return stored

    with monkeypatch.context() as patch:
        patch.setattr(shapes_service, "_store", slow)
        with send(single, "/shapes", **file_form(small_file(6), "whole.off")):
            assert begun.wait(60)
        wait_until(lambda: not single.container.queue.inside, seconds=5)
        go_on.set()
        assert done.wait(60)
    (shape,) = single.client.get("/shapes", params={"name": "whole.off"}).json()["shapes"]
    assert single.client.get(f"/shapes/{shape['id']}/file").content == small_file(6)
    assert single.client.get(f"/shapes/{shape['id']}/embedding").status_code == 200


def test_a_service_that_is_asked_to_stop_finishes_what_it_has(tmp_path: Path) -> None:
    settings = settings_in(tmp_path, workers=1, shutdown_seconds=60)
    with serving(settings) as running, ThreadPoolExecutor(6) as others:
        held = running.container.pool.submit(meet, str(tmp_path / "held"), str(tmp_path / "go on"))
        sent = [
            others.submit(upload, running.client, small_file(number), f"{number}.off") for number in range(6)
        ]
        wait_until(lambda: running.container.queue.inside == 6, seconds=60)
        assert not held.done()
        running.server.should_exit = True
        wait_until(lambda: not running.server.servers[0].is_serving(), seconds=10)
        (tmp_path / "go on").touch()
        answers = [each.result() for each in sent]
    assert [answer.status_code for answer in answers] == [201] * 6
    with serving(settings, ready=False) as running:
        stored = {shape["id"] for shape in running.client.get("/shapes").json()["shapes"]}
    assert stored == {answer.json()["id"] for answer in answers}


def test_a_service_that_is_asked_to_stop_refuses_what_it_cannot_finish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = settings_in(tmp_path, workers=1, shutdown_seconds=1)
    with serving(settings) as running, ThreadPoolExecutor(2) as others:
        monkeypatch.setattr(work_module, "embed_mesh", nap_instead)
        half_sent = send(running, "/shapes", part=0.5, **file_form(small_file(2), "half sent.off"))
        sent = [
            others.submit(upload, running.client, small_file(0), "at work.off"),
            others.submit(query, running.client, small_file(1)),
        ]
        wait_until(
            lambda: running.container.queue.inside == 2 and napping(running.container.pool), seconds=60
        )
        running.server.should_exit = True
        for each in sent:
            assert_problem(each.result(), 503, "shutting-down")
        with half_sent:
            answer = b"".join(iter(lambda: half_sent.recv(65536), b""))
    assert answer.startswith(b"HTTP/1.1 503 ")
    assert b"urn:isoshape:problem:shutting-down" in answer
    with pytest.raises(httpx.TransportError):
        httpx.get(f"{running.client.base_url}/healthz")
