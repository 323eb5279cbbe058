"""Logs: lines of JSON with request ids, and nothing of what was sent."""

import io
import json
import logging
from collections.abc import Iterator

import pytest

from service.compute import pool, request_queue, tasks
from service.observability.logging import LOGGER, JsonFormatter, configure, get_logger, request_id
from tests.service.support import Running, assert_problem, query, small_file, upload, wait_until
from tests.service.tasks import fail_unexpectedly


@pytest.fixture
def lines() -> Iterator[io.StringIO]:
    """The messages logged meanwhile, from debug up."""
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(JsonFormatter())
    logger = logging.getLogger(LOGGER)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    yield stream
    logger.removeHandler(handler)
    logger.setLevel(level)


def test_a_line_is_one_object_even_with_a_traceback(lines: io.StringIO) -> None:
    token = request_id.set("abc")
    try:
        raise ValueError('a "quoted"\nmessage')
    except ValueError as error:
        get_logger("test").error("it %s", "failed", exc_info=error, extra={"fields": {"status": 500}})
    request_id.reset(token)
    get_logger("test").info("outside")
    # Services of other tests may log at the same time.
    told = [json.loads(line) for line in lines.getvalue().splitlines()]
    first, second = (line for line in told if line["logger"] == "isoshape.test")
    assert (first["level"], first["message"]) == ("error", "it failed")
    assert (first["request_id"], first["status"]) == ("abc", 500)
    assert "ValueError" in first["traceback"]
    assert "request_id" not in second


@pytest.mark.parametrize(
    ("path", "status", "problem"), [("/shapes", 200, None), ("/shapes/none", 404, "shape-not-found")]
)
def test_every_request_is_logged_once_with_its_id_and_its_problem(
    shared: Running, lines: io.StringIO, path: str, status: int, problem: str | None
) -> None:
    shared.client.get(path, headers={"x-request-id": "find-me"})
    wait_until(lambda: "find-me" in lines.getvalue(), seconds=5)
    (line,) = [json.loads(line) for line in lines.getvalue().splitlines() if "find-me" in line]
    assert line["request_id"] == "find-me"
    assert (line["method"], line["path"], line["status"]) == ("GET", path, status)
    assert line["milliseconds"] > 0
    assert line.get("problem") == problem


def test_nothing_of_what_was_sent_is_logged(shared: Running, lines: io.StringIO) -> None:
    secret = "xyzzy-secret"
    upload(shared.client, small_file(0), f"{secret}.off", tags=secret, metadata=f'{{"k": "{secret}"}}')
    upload(shared.client, f"OFF {secret}".encode(), f"{secret}.off")
    query(shared.client, secret.encode(), f"{secret}.off", tag=secret)
    wait_until(lambda: lines.getvalue().count('"/query"') == 1, seconds=5)
    assert secret not in lines.getvalue()


def test_configuring_twice_writes_once() -> None:
    logger = logging.getLogger(LOGGER)
    before, level = list(logger.handlers), logger.level
    configure("info")
    configure("error")
    added = [handler for handler in logger.handlers if handler not in before]
    assert len(added) <= 1
    assert logger.level == logging.ERROR
    for handler in added:
        logger.removeHandler(handler)
    logger.setLevel(level)


def test_a_failure_of_the_method_is_logged_and_the_worker_goes_on(
    shared: Running, lines: io.StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Tests before this one may have left large workers, which are renewed.
    monkeypatch.setattr(pool, "MEMORY_BYTES", 2**40)
    wait_until(lambda: shared.container.pool.counts().idle == 2, seconds=60)
    workers = shared.container.pool.pids()
    first, second = (shared.store(small_file(number))["id"] for number in (1, 2))
    with monkeypatch.context() as patch:
        for module, task in ((request_queue, "embed_mesh"), (tasks, "match_embeddings")):
            patch.setattr(module, task, fail_unexpectedly)
        for answer in (
            upload(shared.client, small_file(77), "table.off"),
            query(shared.client, small_file(77)),
            shared.client.post("/compare", json={"first": first, "second": second}),
        ):
            problem = assert_problem(answer, 422, "cannot-be-embedded")
            assert "divide by zero" not in problem["detail"]
    logged = [json.loads(line) for line in lines.getvalue().splitlines()]
    events = [line for line in logged if line["message"] == "the method failed on a mesh"]
    assert len(events) == 3
    assert all("divide by zero encountered in log" in event["traceback"] for event in events)
    assert shared.container.pool.pids() == workers
    assert upload(shared.client, small_file(77), "table.off").status_code == 201
