"""Routes: their methods, headers, access, parameters that are given twice, and a service that starts."""

from collections.abc import Iterator

import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute
from starlette.routing import Route

from core.io import write_mesh
from service import app
from service.app import create_app
from service.auth.keys import digest_of
from service.compute.pool import LocalPool
from service.settings import Settings
from service.system import endpoints
from tests.core.shapes import icosphere
from tests.service.support import Running, assert_problem, document, module_service, operations

FULL, READ = "isoshape_full-key", "isoshape_read-key"
KEYS = {"none": None, "wrong": "isoshape_wrong-key", "read": READ, "full": FULL}

OPEN = {
    ("GET", "/healthz"),
    ("GET", "/readyz"),
    ("GET", "/session"),
    ("DELETE", "/session"),
    # Not in the document: where it is shown.
    ("GET", "/"),
    ("GET", "/docs"),
    ("GET", "/page/{name:path}"),
    ("GET", "/openapi.json"),
}
# Beside GET and HEAD. Any other method changes something.
READING = {("POST", path) for path in ("/query", "/query/batch", "/compare", "/preview", "/session")}

DOCUMENTED = operations()


def routes_of(app: FastAPI) -> Iterator[tuple[str, str]]:
    """Every method and address that the app answers, those that the document leaves out too."""
    pending = list(app.routes)
    while pending:
        route = pending.pop()
        inner = getattr(route, "original_router", None)
        if inner is not None:
            pending += inner.routes
        else:
            assert isinstance(route, Route | APIRoute), f"{route} is none of the kinds that the gate looks at"
            yield from ((method, route.path) for method in route.methods or ())


ROUTES = sorted(set(routes_of(create_app(Settings()))))


locked = module_service(ready=False, api_keys=(digest_of(FULL),), read_keys=(digest_of(READ),), rate_limit=0)


def allowed(method: str, path: str) -> set[str]:
    """Which of the keys may."""
    if ("GET" if method == "HEAD" else method, path) in OPEN:
        return set(KEYS)
    # Answers about sources have paths of the machine.
    if not path.startswith(("/sources", "/equal-files")) and (
        method in {"GET", "HEAD"} or (method, path) in READING
    ):
        return {"read", "full"}
    return {"full"}


def test_every_documented_address_is_among_the_routes() -> None:
    assert set(DOCUMENTED) < set(ROUTES)
    assert {("POST", "/shapes"), ("HEAD", "/shapes/{shape_id}/file"), ("GET", "/docs")} <= set(ROUTES)
    assert set(ROUTES) >= OPEN | READING


@pytest.mark.parametrize(("method", "path"), ROUTES, ids=map(" ".join, ROUTES))
def test_who_may_use_an_address(locked: Running, method: str, path: str) -> None:
    address = path.replace("{shape_id}", "no-such-shape")
    for name, key in KEYS.items():
        headers = {} if key is None else {"authorization": f"Bearer {key}"}
        answer = locked.client.request(method, address, headers=headers)
        locked.client.cookies.clear()
        if (method, path, name) == ("GET", "/session", "wrong"):
            # It tells what the key may do, and this one is none.
            assert_problem(answer, 401, "unauthorized")
        elif name in allowed(method, path):
            assert answer.status_code not in {401, 403}, name
        else:
            status, kind = (403, "forbidden") if name == "read" else (401, "unauthorized")
            assert answer.status_code == status, name
            if method != "HEAD":
                assert_problem(answer, status, kind)
            assert answer.headers["www-authenticate"].startswith("Bearer ")


@pytest.mark.parametrize(("method", "path"), DOCUMENTED, ids=map(" ".join, DOCUMENTED))
def test_the_document_says_who_may(method: str, path: str) -> None:
    operation = DOCUMENTED[method, path]
    keys = allowed(method, path)
    statuses = set(operation["responses"])
    assert (operation["security"] == []) == ("none" in keys)
    assert ("401" in statuses) == ("wrong" not in keys or (method, path) == ("GET", "/session"))
    assert ("429" in statuses) == ("none" not in keys)
    in_a_collection = any(one["name"] == "collection" for one in operation.get("parameters", []))
    assert ("403" in statuses) == (method != "GET" or in_a_collection)


def test_the_document_names_the_schemes_that_it_uses() -> None:
    schemes = document()["components"]["securitySchemes"]
    for operation in DOCUMENTED.values():
        assert all(set(each) <= set(schemes) for each in operation["security"])


@pytest.mark.parametrize(
    "origin", ["http://[", "http://]", "http://[::1", "//[", "[", "", "null", "\xff", "a" * 9000]
)
@pytest.mark.parametrize(
    ("method", "path"), [("POST", "/shapes"), ("DELETE", "/session"), ("PUT", "/nothing")]
)
def test_an_origin_that_is_no_url_is_another_site(
    shared: Running, method: str, path: str, origin: str
) -> None:
    answer = shared.client.request(method, path, headers=[(b"Origin", origin.encode("latin-1"))])
    assert_problem(answer, 403, "cross-site")


@pytest.mark.parametrize(
    ("method", "path"),
    [("GET", "/"), ("GET", "/shapes"), ("POST", "/shapes"), ("GET", "/healthz"), ("GET", "/no")],
)
def test_a_page_with_a_rebound_name_is_refused(shared: Running, method: str, path: str) -> None:
    """The page is same-origin for its browser, which therefore lets it read and upload."""
    rebound = {"host": "rebound.example", "origin": "http://rebound.example", "sec-fetch-site": "same-origin"}
    assert_problem(shared.client.request(method, path, headers=rebound), 421, "misdirected-request")
    for host in ("localhost:1", "127.0.0.1", "[::1]:8000"):
        assert shared.client.get("/shapes", headers={"host": host}).status_code == 200


PARAMETERS = [
    pytest.param(method, path, parameter, id=f"{method} {path} {parameter['name']}")
    for (method, path), operation in DOCUMENTED.items()
    for parameter in operation.get("parameters", [])
    if parameter["in"] == "query"
]


def test_there_are_lists_and_others() -> None:
    lists = {each.values[2]["name"] for each in PARAMETERS if each.values[2]["schema"].get("type") == "array"}
    assert lists == {"tag", "metadata", "exclude", "shape_id"}
    assert len(PARAMETERS) > 2 * len(lists)


@pytest.mark.parametrize(("method", "path", "parameter"), PARAMETERS)
def test_only_a_list_may_be_given_twice(shared: Running, method: str, path: str, parameter: dict) -> None:
    address = path.replace("{shape_id}", "none").replace("{job_id}", "none")
    name, value = parameter["name"], "a=b"
    answer = shared.client.request(method, address, params=[(name, value), (name, value)])
    # The answer may be a picture.
    faults = answer.json().get("errors", []) if "json" in answer.headers["content-type"] else []
    if parameter["schema"].get("type") == "array":
        assert faults == []
    else:
        assert_problem(answer, 422, "bad-request-fields")
        assert faults == [{"field": name, "message": "given more than once"}]


def test_a_parameter_that_an_address_does_not_know_may_be_given_twice(shared: Running) -> None:
    assert shared.client.get("/healthz", params=[("x", "1"), ("x", "1")]).status_code == 200


@pytest.mark.parametrize(("compiled", "told"), [(False, "kernels are compiled"), (True, "no worker process")])
def test_readyz_tells_of_the_compilation(
    shared: Running, monkeypatch: pytest.MonkeyPatch, compiled: bool, told: str
) -> None:
    monkeypatch.setattr(LocalPool, "ready", lambda pool: False)
    monkeypatch.setattr(endpoints, "is_compiled", lambda parameters: compiled)
    problem = assert_problem(shared.client.get("/readyz"), 503, "not-ready")
    assert told in problem["detail"]
    # The page is sent meanwhile, with the place where it says so.
    assert 'id="starting"' in shared.client.get("/").text


def test_uploads_and_queries_are_refused_while_no_worker_can_start(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LocalPool, "pids", lambda pool: [])
    monkeypatch.setattr(app, "is_compiled", lambda parameters: False)
    file = {"file": ("ball.off", write_mesh(icosphere(2), "off"))}
    for address in ("/shapes", "/query"):
        answer = service.client.post(address, files=file)
        assert "kernels are compiled" in assert_problem(answer, 503, "not-ready")["detail"]
        assert int(answer.headers["Retry-After"]) > 0
    monkeypatch.setattr(app, "is_compiled", lambda parameters: True)
    assert service.client.post("/shapes", files=file).status_code == 201
