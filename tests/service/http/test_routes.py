"""Every address of the service and who may use it, read off the service, so that none is forgotten."""

from collections.abc import Iterator

import httpx
import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute
from starlette.routing import Route

from service.app import create_app
from service.auth.keys import digest_of
from service.openapi_document import document
from service.settings import Settings
from tests.service.support import assert_problem, serving, settings_in

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
READING = {("POST", "/query"), ("POST", "/compare"), ("POST", "/preview"), ("POST", "/session")}

DOCUMENTED = {
    (method.upper(), path): operation
    for path, operations in document()["paths"].items()
    for method, operation in operations.items()
}


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


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    settings = settings_in(
        tmp_path_factory.mktemp("keys"),
        workers=1,
        api_keys=(digest_of(FULL),),
        read_keys=(digest_of(READ),),
        rate_limit=0,
    )
    with serving(settings, ready=False) as running:
        yield running.client


def allowed(method: str, path: str) -> set[str]:
    """Which of the keys may."""
    if ("GET" if method == "HEAD" else method, path) in OPEN:
        return set(KEYS)
    if method in {"GET", "HEAD"} or (method, path) in READING:
        return {"read", "full"}
    return {"full"}


def test_every_documented_address_is_among_the_routes() -> None:
    assert set(DOCUMENTED) < set(ROUTES)
    assert {("POST", "/shapes"), ("HEAD", "/shapes/{shape_id}/file"), ("GET", "/docs")} <= set(ROUTES)
    assert set(ROUTES) >= OPEN | READING


@pytest.mark.parametrize(("method", "path"), ROUTES, ids=map(" ".join, ROUTES))
@pytest.mark.parametrize("name", KEYS)
def test_who_may_use_an_address(client: httpx.Client, method: str, path: str, name: str) -> None:
    key = KEYS[name]
    headers = {} if key is None else {"authorization": f"Bearer {key}"}
    answer = client.request(method, path.replace("{shape_id}", "no-such-shape"), headers=headers)
    client.cookies.clear()
    if (method, path, name) == ("GET", "/session", "wrong"):
        # It tells what the key may do, and this one is none.
        assert_problem(answer, 401, "unauthorized")
    elif name in allowed(method, path):
        assert answer.status_code not in {401, 403}
    else:
        status, kind = (403, "forbidden") if name == "read" else (401, "unauthorized")
        if method == "HEAD":
            assert answer.status_code == status
        else:
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
