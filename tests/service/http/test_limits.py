"""Limits on what is sent and on how long it is worked on; what happens when workers die."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from service import turns
from service.compute import request_queue as work_module
from service.compute import tasks
from tests.service.support import (
    Running,
    assert_problem,
    module_service,
    query,
    small_file,
    upload,
    wait_until,
)
from tests.service.tasks import nap_instead, napping

LIMIT = 40_000
VERTICES = 200
TASK_SECONDS = 1.5
"""The time limit of a task that never ends; others may have to wait for a machine with other work."""


strict = module_service(
    queue_length=0, task_seconds=50, max_upload_bytes=LIMIT, max_vertices=VERTICES, max_faces=2 * VERTICES
)
"""A service with one worker and no queue."""


def test_a_file_above_the_limit_is_refused(strict: Running) -> None:
    for size in (LIMIT + 1, LIMIT + 2 * 1024 * 1024):
        for send in (upload, query):
            problem = assert_problem(send(strict.client, b"x" * size, "big.off"), 413, "body-too-large")
            assert f"at most {LIMIT} bytes" in problem["detail"]


def test_a_body_that_does_not_say_its_length_is_counted(strict: Running) -> None:
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="big.off"\r\n\r\n'
        while sent < 500 * 1024 * 1024:
            sent += 64 * 1024
            yield b"x" * (64 * 1024)

    headers = {"content-type": "multipart/form-data; boundary=b"}
    try:
        answer = strict.client.post("/shapes", content=endless(), headers=headers)
    except httpx.TransportError:
        pass
    else:
        assert_problem(answer, 413, "body-too-large")
    assert sent < 20 * 1024 * 1024
    assert strict.client.get("/healthz").status_code == 200


def test_a_body_that_is_no_form_is_small(strict: Running) -> None:
    body = b'{"first": "' + b"x" * 2_000_000 + b'"}'
    headers = {"content-type": "application/json"}
    for path in ("/compare", "/query"):
        assert_problem(strict.client.post(path, content=body, headers=headers), 413, "body-too-large")
        chunks = (body[i : i + 100_000] for i in range(0, len(body), 100_000))
        assert_problem(strict.client.post(path, content=chunks, headers=headers), 413, "body-too-large")


def test_a_mesh_above_the_limit_is_refused(strict: Running) -> None:
    data = b"OFF\n300 1 0\n" + b"0 1 2\n" * 300 + b"3 0 1 2\n"
    problem = assert_problem(upload(strict.client, data, "many.off"), 422, "mesh-too-complex")
    assert str(VERTICES) in problem["detail"]


def test_compared_files_have_the_limits_of_uploads(strict: Running) -> None:
    small = ("small.off", small_file(0))
    many = ("many.off", b"OFF\n300 1 0\n" + b"0 1 2\n" * 300 + b"3 0 1 2\n")
    for files in ({"first": small, "second": many}, {"first": many, "second": small}):
        answer = strict.client.post("/compare?dense=true", files=files)
        assert_problem(answer, 422, "mesh-too-complex")
    large = ("large.off", b"x" * (strict.container.settings.max_upload_bytes + 1))
    answer = strict.client.post("/compare?dense=true", files={"first": small, "second": large})
    assert_problem(answer, 413, "body-too-large")


def test_an_unexpected_error_of_a_reader_is_a_refusal_of_its_file(
    strict: Running, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Here a TypeError: `len` takes one argument."""
    with monkeypatch.context() as patch:
        patch.setattr(work_module, "read_file", len)
        assert_problem(upload(strict.client, small_file(1), "odd.off"), 422, "malformed-mesh")
    assert "a reader failed on a file" in caplog.messages


def test_work_that_takes_too_long_is_stopped_and_the_worker_replaced(
    strict: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    pool = strict.container.pool
    assert pool.seconds == strict.container.settings.task_seconds
    before = pool.pids()
    with monkeypatch.context() as patch:
        patch.setattr(pool, "seconds", TASK_SECONDS)
        patch.setattr(work_module, "embed_mesh", nap_instead)
        problem = assert_problem(upload(strict.client, small_file(1), "slow.off"), 422, "file-time-limit")
    assert f"{TASK_SECONDS} s" in problem["detail"]
    wait_until(pool.pids, seconds=60)
    assert pool.pids() != before
    assert upload(strict.client, small_file(1), "quick.off").status_code == 201


def test_a_comparison_that_takes_too_long_may_be_tried_again(
    strict: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    shape = strict.store(small_file(1))
    with monkeypatch.context() as patch:
        patch.setattr(strict.container.pool, "seconds", TASK_SECONDS)
        patch.setattr(tasks, "match_embeddings", nap_instead)
        pair = {"first": shape["id"], "second": shape["id"]}
        assert_problem(strict.client.post("/compare", json=pair), 503, "time-limit")
    wait_until(strict.container.pool.pids, seconds=60)
    assert strict.client.post("/compare", json=pair).status_code == 200


def test_more_requests_than_may_wait_are_turned_away(
    strict: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch, ThreadPoolExecutor(1) as others:
        patch.setattr(work_module, "embed_mesh", nap_instead)
        patch.setattr(turns, "PATIENCE_SECONDS", 0.1)
        first = others.submit(upload, strict.client, small_file(2), "first.off")
        wait_until(lambda: napping(strict.container.pool), seconds=60)
        shape = strict.client.get("/shapes").json()["shapes"][0]
        for answer in (
            upload(strict.client, small_file(3), "second.off"),
            query(strict.client, small_file(3)),
            strict.client.post("/query", json={"shape_id": shape["id"]}),
            strict.client.post("/compare", json={"first": shape["id"], "second": shape["id"]}),
        ):
            assert_problem(answer, 503, "busy")
        assert strict.client.get("/shapes").status_code == 200
        assert strict.client.get("/readyz").status_code == 200
        # The pool may have one more worker, which is idle.
        worker = napping(strict.container.pool)
        assert worker is not None
        os.kill(worker, signal.SIGKILL)
        assert_problem(first.result(), 503, "worker-lost")
    wait_until(strict.container.pool.pids, seconds=60)
    assert upload(strict.client, small_file(3), "second.off").status_code == 201
