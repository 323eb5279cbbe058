"""Headers of requests that no ordinary client sends."""

import pytest

from tests.service.support import Running, assert_problem


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
