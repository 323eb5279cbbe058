"""One form of error, on every route."""

import inspect
import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from core import errors as core_errors
from service import errors as service_errors
from service.errors import BY_STATUS, PROBLEMS
from service.http.problem_document import TYPE_PREFIX
from service.jobs import zip_archive
from tests.service.support import Running, assert_problem, document, operations, small_file, wait_until

METHODS = {"GET", "POST", "PUT", "PATCH", "DELETE"}
OPERATIONS = list(operations())


def address(path: str) -> str:
    return path.replace("{shape_id}", "no-such-shape")


def subclasses(base: type[Exception]) -> Iterator[type[Exception]]:
    yield base
    for derived in base.__subclasses__():
        yield from subclasses(derived)


def test_every_error_has_its_row_and_every_row_its_use() -> None:
    kinds = {
        error.kind  # type: ignore[attr-defined]
        for base in (core_errors.CoreError, service_errors.ServiceError)
        for error in subclasses(base)
    }
    of_members = set(re.findall(r'MemberError\(\s*"([a-z-]+)"', inspect.getsource(zip_archive)))
    assert kinds | of_members | set(BY_STATUS.values()) == set(PROBLEMS)
    assert all(400 <= row.status < 600 for row in PROBLEMS.values())
    assert all(PROBLEMS[kind].status == status for status, kind in BY_STATUS.items())


@pytest.mark.parametrize("path", sorted({path for _, path in OPERATIONS}))
def test_a_method_that_an_address_does_not_answer(shared: Running, path: str) -> None:
    allowed = {method for method, each in OPERATIONS if each == path}
    for method in METHODS - allowed:
        answer = shared.client.request(method, address(path))
        assert_problem(answer, 405, "method-not-allowed")
        assert set(answer.headers["allow"].split(", ")) - {"HEAD"} == allowed


@pytest.mark.parametrize(
    "path", ["/nothing", "/shapes/", "/shapes/a/b", "/query/x", "/%00", "/shapes/a/file/x"]
)
def test_an_address_where_nothing_is(shared: Running, path: str) -> None:
    answer = shared.client.get(path)
    assert_problem(answer, 404, "not-found")


@pytest.mark.parametrize(("method", "path"), [each for each in OPERATIONS if "{shape_id}" in each[1]])
def test_a_shape_that_is_not_there(shared: Running, method: str, path: str) -> None:
    bodies: dict[str, dict[str, Any]] = {
        "PATCH": {"json": {}},
        "PUT": {"files": {"file": ("shape.off", small_file(0))}},
    }
    body = bodies.get(method, {})
    assert_problem(shared.client.request(method, address(path), **body), 404, "shape-not-found")
    long = path.replace("{shape_id}", "x" * 65)
    assert_problem(shared.client.request(method, long, **body), 422, "bad-request-fields")


def test_a_request_has_an_id_of_its_own_or_the_one_it_came_with(shared: Running) -> None:
    first, second = shared.client.get("/healthz"), shared.client.get("/healthz")
    assert first.headers["x-request-id"] != second.headers["x-request-id"]
    given = shared.client.get("/nothing", headers={"x-request-id": "mine-1.2_3"})
    assert assert_problem(given, 404, "not-found")["request_id"] == "mine-1.2_3"
    for bad in ("a b", "x" * 65, "a\tb", "{}", ""):
        answer = shared.client.get("/nothing", headers={"x-request-id": bad})
        assert assert_problem(answer, 404, "not-found")["request_id"] != bad


def test_types_are_documented_and_stable(shared: Running) -> None:
    schema = document()["components"]["schemas"]["Problem"]
    assert schema["properties"]["type"]["enum"] == [TYPE_PREFIX + kind for kind in PROBLEMS]


def test_an_error_that_no_one_foresaw_is_a_problem_too(
    shared: Running, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_arguments: object) -> None:
        raise ZeroDivisionError("a secret")

    with monkeypatch.context() as patch:
        patch.setattr("service.shapes.service.get", fail)
        answer = shared.client.get("/shapes/x")
    problem = assert_problem(answer, 500, "internal-error")
    assert "secret" not in json.dumps(problem)
    wait_until(
        lambda: any("ZeroDivisionError" in str(record.exc_info) for record in caplog.records), seconds=5
    )
