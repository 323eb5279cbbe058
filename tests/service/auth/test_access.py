"""The parts of the gate, without a service."""

import hashlib
import re

import pytest
from starlette.datastructures import Headers

from service.auth.gate import Gate, RateLimit, check_host, from_another_site, key_in, name_in, needed
from service.auth.keys import COOKIE, MOST_EACH, SECONDS, Grant, KeyRing, Sessions, digest_of, new_key
from service.errors import CrossSiteError, ForbiddenError, MisdirectedRequestError, UnauthorizedError
from service.settings import Settings


class Clock:
    """Seconds, as the test says."""

    def __init__(self) -> None:
        self.now = 1e6

    def __call__(self) -> float:
        return self.now


def test_keys_are_random_and_go_into_a_header() -> None:
    keys = {new_key() for _ in range(100)}
    assert len(keys) == 100
    # 32 bytes in base 64.
    assert all(re.fullmatch(r"isoshape_[A-Za-z0-9_-]{43}", key) for key in keys)


def test_a_digest_is_the_sha_256() -> None:
    # FIPS 180-2, appendix B.1.
    assert digest_of("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert digest_of("ä") == hashlib.sha256("ä".encode()).hexdigest()


def test_a_key_may_what_its_list_says() -> None:
    ring = KeyRing(full=[digest_of("a"), digest_of("both")], read=[digest_of("r"), digest_of("both")])
    assert ring.grant("a") == Grant("full", digest_of("a"))
    assert ring.grant("r") == Grant("read", digest_of("r"))
    assert ring.grant("both") == Grant("full", digest_of("both"))
    for wrong in ("", "A", "a ", digest_of("a")):
        assert ring.grant(wrong) is None
    assert ring
    assert not KeyRing([], [])


@pytest.mark.parametrize("per_minute", [1, 7, 60, 1200])
def test_so_many_at_once_and_then_so_many_a_minute(per_minute: int) -> None:
    clock = Clock()
    rates = RateLimit(per_minute, clock)
    assert [rates.wait("k") for _ in range(per_minute)] == [None] * per_minute
    wait = rates.wait("k")
    assert wait == max(1, round(60 / per_minute + 0.5 - 1e-9) if 60 % per_minute else 60 // per_minute)
    assert rates.wait("another") is None
    clock.now += wait
    assert rates.wait("k") is None
    clock.now += 60
    passed = sum(rates.wait("k") is None for _ in range(2 * per_minute))
    assert passed == per_minute
    # Asking all the time, and being refused, costs nothing: ten minutes let ten times as many through.
    passed = 0
    for _ in range(10 * 60 * 40):
        clock.now += 1 / 40
        passed += rates.wait("k") is None
    assert abs(passed - 10 * per_minute) <= 1


def test_no_limit() -> None:
    rates = RateLimit(0, Clock())
    assert all(rates.wait("k") is None for _ in range(10_000))


def test_a_session_ends_when_it_is_ended_or_old() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    grant = Grant("read", digest_of("r"))
    one, other = sessions.begin(grant, "here"), sessions.begin(grant, "here")
    assert one != other
    assert sessions.grant(one, "here") == Grant("read", digest_of("r"), signed_in=True)
    sessions.end(one)
    sessions.end("unknown")
    assert sessions.grant(one, "here") is None
    clock.now += SECONDS - 1
    assert sessions.grant(other, "here") is not None
    clock.now += 1
    assert sessions.grant(other, "here") is None
    assert sessions.grant("", "here") is None


def test_a_key_has_only_so_many_sessions_and_ends_none_of_another_key() -> None:
    sessions = Sessions(Clock())
    others = sessions.begin(Grant("full", "other"), "here")
    tokens = [sessions.begin(Grant("read", "d"), "here") for _ in range(MOST_EACH + 2)]
    assert [token for token in tokens if sessions.grant(token, "here") is None] == tokens[:2]
    assert sessions.grant(others, "here") is not None


@pytest.mark.parametrize(
    ("headers", "key"),
    [
        ({}, None),
        ({"authorization": "Bearer abc"}, "abc"),
        ({"authorization": "bearer  abc "}, "abc"),
        ({"x-api-key": "abc"}, "abc"),
        ({"authorization": "Basic YTpi"}, None),
        ({"authorization": "Basic YTpi", "x-api-key": "abc"}, "abc"),
        ({"authorization": "Bearer abc", "x-api-key": "other"}, "abc"),
        ({"authorization": "Bearer"}, ""),
        ({"x-api-key": ""}, ""),
    ],
)
def test_where_a_key_is_read(headers: dict[str, str], key: str | None) -> None:
    assert key_in(Headers(headers)) == key


@pytest.mark.parametrize(
    ("headers", "foreign"),
    [
        ({}, False),
        ({"sec-fetch-site": "same-origin"}, False),
        ({"sec-fetch-site": "none"}, False),
        ({"sec-fetch-site": "same-site"}, True),
        ({"sec-fetch-site": "cross-site"}, True),
        ({"sec-fetch-site": "cross-site", "origin": "http://here:8000"}, True),
        ({"origin": "http://here:8000"}, False),
        ({"origin": "http://here:3000"}, True),
        ({"origin": "http://evil.example"}, True),
        ({"origin": "null"}, True),
        # No URL, which the standard library refuses to split.
        ({"origin": "http://["}, True),
        ({"origin": "http://]"}, True),
    ],
)
def test_pages_of_other_sites_are_known(headers: dict[str, str], foreign: bool) -> None:
    assert from_another_site(Headers({"host": "here:8000", **headers})) is foreign


def test_an_operation_that_no_rule_names_is_closed() -> None:
    assert needed("GET", "/new") == "read"
    assert needed("HEAD", "/new") == "read"
    for method in ("POST", "PUT", "PATCH", "DELETE", "TRACE", "ANYTHING"):
        assert needed(method, "/new") == "full"
    assert needed("POST", "/query/") == needed("POST", "//query") == needed("PUT", "/query") == "full"
    assert needed("GET", "/healthz/") == "read"
    assert needed("HEAD", "/healthz") is None


def gate(**settings: object) -> Gate:
    chosen = Settings(**{"api_keys": (digest_of("full"),), "read_keys": (digest_of("read"),), **settings})
    hosts = {*chosen.hosts, chosen.host} if chosen.hosts else None
    return Gate(KeyRing(chosen.api_keys, chosen.read_keys), chosen.rate_limit, hosts)


def test_the_gate() -> None:
    one = gate()
    for method, path in (("GET", "/shapes"), ("POST", "/query"), ("POST", "/shapes")):
        with pytest.raises(UnauthorizedError) as refused:
            one.admit(method, path, Headers())
        assert refused.value.challenge == 'Bearer realm="isoshape"'
        with pytest.raises(UnauthorizedError) as refused:
            one.admit(method, path, Headers({"x-api-key": "wrong"}))
        assert refused.value.challenge == 'Bearer realm="isoshape", error="invalid_token"'
        assert one.admit(method, path, Headers({"x-api-key": "full"})) == Grant("full", digest_of("full"))
    assert one.admit("POST", "/query", Headers({"x-api-key": "read"})) == Grant("read", digest_of("read"))
    with pytest.raises(ForbiddenError):
        one.admit("POST", "/shapes", Headers({"x-api-key": "read"}))
    assert one.admit("GET", "/healthz", Headers({"x-api-key": "wrong"})) is None


def test_probes_need_no_name_of_a_service_with_keys() -> None:
    named, unkeyed = gate(hosts=("parts.example",)), gate(hosts=("parts.example",), api_keys=(), read_keys=())
    by_address = Headers({"host": "10.0.0.7:8000", "x-api-key": "full"})
    for path in ("/healthz", "/readyz"):
        assert named.admit("GET", path, by_address) is None
        with pytest.raises(MisdirectedRequestError):
            unkeyed.admit("GET", path, by_address)
    with pytest.raises(MisdirectedRequestError):
        named.admit("GET", "/shapes", by_address)


def test_a_cookie_is_a_key_for_its_own_site_alone() -> None:
    one = gate()
    cookie = {
        "host": "here",
        "cookie": f"a=b; {COOKIE}={one.sessions.begin(Grant('full', 'd'), 'here')}; broken",
    }
    assert one.admit("POST", "/shapes", Headers({**cookie, "origin": "http://here"})) is not None
    with pytest.raises(CrossSiteError):
        one.admit("POST", "/shapes", Headers({**cookie, "origin": "http://evil.example"}))
    with pytest.raises(UnauthorizedError):
        one.admit("GET", "/shapes", Headers({"cookie": f"{COOKIE}=guessed"}))
    with pytest.raises(MisdirectedRequestError):
        one.admit("GET", "/shapes", Headers({**cookie, "host": "rebound.example"}))
    # A wrong key is said to be wrong, whatever the cookie says.
    with pytest.raises(UnauthorizedError):
        one.admit("GET", "/shapes", Headers({**cookie, "x-api-key": "wrong"}))


def test_a_service_with_read_keys_alone_is_read_only() -> None:
    one = gate(api_keys=())
    assert one.admit("GET", "/shapes", Headers({"x-api-key": "read"})) == Grant("read", digest_of("read"))
    for key, error in (("read", ForbiddenError), ("full", UnauthorizedError)):
        with pytest.raises(error):
            one.admit("DELETE", "/shapes/x", Headers({"x-api-key": key}))


@pytest.mark.parametrize(
    ("host", "name"),
    [
        ("Here.Example:8000", "here.example"),
        ("here.example.", "here.example"),
        ("127.0.0.1:80", "127.0.0.1"),
        ("[::1]:8000", "::1"),
        ("::1", "::1"),
        ("", ""),
        ("user@evil.example", "user@evil.example"),
    ],
)
def test_the_name_in_a_host(host: str, name: str) -> None:
    assert name_in(host) == name


LOOPBACK = ("localhost", "LOCALHOST:8000", "127.0.0.1:8000", "127.9.9.9", "[::1]:8000")
FOREIGN = (
    "rebound.example",
    "localhost.rebound.example",
    "127.0.0.1.rebound.example:8000",
    "10.0.0.1",
    "",
    "[::2]",
)


def test_a_service_without_a_key_answers_to_its_own_names() -> None:
    known = {"parts.example", "192.0.2.7", "fd00::7"}
    for host in (*LOOPBACK, "parts.example", "PARTS.example:80", "192.0.2.7:8000", "[fd00::7]:80"):
        check_host(Headers({"host": host}), known)
    for host in FOREIGN:
        with pytest.raises(MisdirectedRequestError):
            check_host(Headers({"host": host}), known)
    with pytest.raises(MisdirectedRequestError):
        check_host(Headers(), known)
    with pytest.raises(MisdirectedRequestError):
        check_host(Headers(raw=[(b"host", b"localhost"), (b"host", b"rebound.example")]), known)
    check_host(Headers({"host": "rebound.example"}), None)
