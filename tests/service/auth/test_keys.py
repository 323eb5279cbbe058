"""Keys, sessions and rates over HTTP."""

import io
import json
import logging
from collections.abc import Iterator

import httpx
import pytest

from service.auth.keys import COOKIE, SECONDS, digest_of
from service.observability.logging import LOGGER, JsonFormatter
from tests.service.support import Running, assert_problem, module_service, wait_until

FULL, READ, BUSY = "isoshape_full-key", "isoshape_read-key", "isoshape_busy-key"


@pytest.fixture(scope="module", autouse=True)
def _behind_a_proxy() -> Iterator[None]:
    """A proxy on this machine says what connection it took."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FORWARDED_ALLOW_IPS", "127.0.0.1")
        yield


locked = module_service(
    ready=False,
    api_keys=(digest_of(FULL),),
    read_keys=(digest_of(READ), digest_of(BUSY)),
    rate_limit=30,
    log_level="debug",
)
"""A service with keys behind a proxy, and a client that sends none."""


@pytest.fixture
def browser(locked: Running) -> Iterator[httpx.Client]:
    """Another client, with its own cookies."""
    with httpx.Client(base_url=locked.client.base_url, timeout=60) as client:
        yield client


def test_only_those_with_a_key_are_told_whether_something_is_at_an_address(locked: Running) -> None:
    assert_problem(locked.client.get("/nothing"), 401, "unauthorized")
    assert_problem(locked.client.get("/nothing", headers={"x-api-key": READ}), 404, "not-found")


def test_signing_in_and_out(locked: Running, browser: httpx.Client) -> None:
    assert browser.get("/session").json() == {"access": "none", "signed_in": False}
    assert_problem(browser.post("/session"), 401, "unauthorized")
    assert_problem(browser.post("/session", headers={"x-api-key": "wrong"}), 401, "unauthorized")
    assert not browser.cookies
    begun = browser.post("/session", headers={"x-api-key": READ})
    assert (begun.status_code, begun.json()) == (200, {"access": "read", "signed_in": True})
    cookie = begun.headers["set-cookie"]
    parts = {part.strip().lower() for part in cookie.split(";")[1:]}
    assert parts == {"httponly", "samesite=strict", "path=/", f"max-age={SECONDS}"}
    assert READ not in cookie
    assert digest_of(READ) not in cookie
    assert browser.get("/shapes").status_code == 200
    assert browser.get("/session").json() == {"access": "read", "signed_in": True}
    assert "set-cookie" not in browser.post("/session").headers
    assert_problem(browser.delete("/shapes/x"), 403, "forbidden")
    token = browser.cookies[COOKIE]
    assert browser.delete("/session").status_code == 204
    assert not browser.cookies
    assert_problem(browser.get("/shapes"), 401, "unauthorized")
    again = locked.client.get("/shapes", headers={"cookie": f"{COOKIE}={token}"})
    assert_problem(again, 401, "unauthorized")
    assert browser.delete("/session").status_code == 204


def test_over_https_the_cookie_is_for_https_alone(browser: httpx.Client) -> None:
    headers = {"x-api-key": READ, "x-forwarded-proto": "https"}
    for answer in (browser.post("/session", headers=headers), browser.delete("/session", headers=headers)):
        assert "; secure" in answer.headers["set-cookie"].lower()


def test_a_page_of_another_site_cannot_use_a_cookie(browser: httpx.Client) -> None:
    browser.post("/session", headers={"x-api-key": FULL})
    for foreign in ({"sec-fetch-site": "same-site"}, {"origin": "http://evil.example"}):
        for method, path in (("DELETE", "/shapes/x"), ("POST", "/query"), ("DELETE", "/session")):
            assert_problem(browser.request(method, path, headers=foreign), 403, "cross-site")
    assert_problem(
        browser.delete("/shapes/x", headers={"sec-fetch-site": "same-origin"}), 404, "shape-not-found"
    )


def test_browsers_are_not_told_that_other_sites_may(locked: Running) -> None:
    headers = {"origin": "http://elsewhere.example", "x-api-key": READ}
    asked = {
        **headers,
        "access-control-request-method": "POST",
        "access-control-request-headers": "x-api-key",
    }
    for answer in (
        locked.client.get("/shapes", headers=headers),
        locked.client.options("/shapes", headers=asked),
        locked.client.options("/shapes", headers={**asked, "x-api-key": FULL}),
    ):
        assert not [name for name in answer.headers if name.startswith("access-control")]
    assert answer.status_code == 405


def test_a_key_that_asks_too_often_waits(locked: Running) -> None:
    answers = [locked.client.get("/shapes", headers={"x-api-key": BUSY}) for _ in range(40)]
    refused = [answer for answer in answers if answer.status_code != 200]
    assert refused
    for answer in refused:
        assert_problem(answer, 429, "rate-limit")
        assert answer.headers["retry-after"] in {"1", "2"}
    assert all(answer.status_code == 200 for answer in answers[:30])
    for path in ("/session", "/healthz"):
        assert locked.client.get(path, headers={"x-api-key": BUSY}).status_code == 200
    assert locked.client.get("/shapes", headers={"x-api-key": READ}).status_code == 200


def test_keys_are_not_logged(locked: Running) -> None:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(JsonFormatter())
    logging.getLogger(LOGGER).addHandler(handler)
    try:
        for key in (FULL, READ, "isoshape_wrong-key"):
            for headers in ({"x-api-key": key}, {"authorization": f"Bearer {key}"}):
                locked.client.post("/session", headers=headers)
                locked.client.delete("/shapes/x", headers=headers)
        locked.client.cookies.clear()
        # A line is written once its answer has been sent.
        wait_until(lambda: len(stream.getvalue().splitlines()) >= 12, seconds=5)
    finally:
        logging.getLogger(LOGGER).removeHandler(handler)
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    for secret in (FULL, READ, "isoshape_wrong-key", digest_of(FULL)):
        assert secret not in stream.getvalue()
    # Which key it was can be told all the same.
    assert {line.get("key") for line in lines} == {digest_of(FULL)[:8], digest_of(READ)[:8], None}


def test_a_service_without_keys_needs_none(shared: Running) -> None:
    assert shared.client.get("/session").json() == {"access": "full", "signed_in": False}
    begun = shared.client.post("/session", headers={"x-api-key": "any"})
    assert begun.json() == {"access": "full", "signed_in": False}
    assert "set-cookie" not in begun.headers
    assert_problem(
        shared.client.delete("/shapes/x", headers={"sec-fetch-site": "cross-site"}), 403, "cross-site"
    )
