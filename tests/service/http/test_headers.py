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
