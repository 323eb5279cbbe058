"""Keys that are limited to some collections."""

from collections.abc import Iterator

import httpx
import pytest

from service.auth.keys import Grant, KeyEntry, KeyRing, digest_of
from service.collections.endpoints import HEADER, PARAMETER
from service.settings import Settings
from tests.service.support import Running, assert_problem, serving, settings_in, small_file

ALL, ONE, TWO, READER = "isoshape_all", "isoshape_one", "isoshape_two", "isoshape_reader"
D = "0" * 64


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service with the collections `a` and `b`, each with a shape of its name."""
    full = (digest_of(ALL), f"{digest_of(ONE)}:a", f"{digest_of(TWO)}:a+b")
    read = (f"{digest_of(READER)}:default+b+never-made",)
    folder = tmp_path_factory.mktemp("limited")
    with serving(settings_in(folder, api_keys=full, read_keys=read, rate_limit=0), key=ALL) as running:
        for number, name in enumerate(("a", "b")):
            assert running.client.put(f"/collections/{name}").status_code == 201
            sent = {"files": {"file": (f"in-{name}.off", small_file(number))}}
            answer = running.client.post("/shapes", headers={HEADER: name}, **sent)  # type: ignore[arg-type]
            assert answer.status_code == 201
        yield running


def client_of(running: Running, key: str) -> httpx.Client:
    headers = {"x-api-key": key}
    return httpx.Client(base_url=running.client.base_url, headers=headers, timeout=60)


def names(client: httpx.Client, **named: str) -> list[str]:
    answer = client.get("/shapes", params=named)
    assert answer.status_code == 200, answer.text
    return [shape["name"] for shape in answer.json()["shapes"]]


@pytest.mark.parametrize(
    ("key", "listed"),
    [(ALL, ["a", "b", "default"]), (ONE, ["a"]), (TWO, ["a", "b"]), (READER, ["b", "default"])],
)
def test_a_key_sees_its_collections(running: Running, key: str, listed: list[str]) -> None:
    with client_of(running, key) as client:
        found = [one["name"] for one in client.get("/collections").json()["collections"]]
        assert found == listed
        counts = client.get("/facets", params={PARAMETER: listed[0]}).json()["collections"]
        assert counts == [{"value": name, "count": int(name != "default")} for name in listed]
        for name in ("a", "b", "default", "no-such", ""):
            answer = client.get("/shapes", params={PARAMETER: name})
            if name in listed:
                assert [shape["name"] for shape in answer.json()["shapes"]] == (
                    [] if name == "default" else [f"in-{name}.off"]
                )
            elif key == ALL:
                assert_problem(answer, 404, "collection-not-found")
            else:
                # Whether it is there or not.
                told = assert_problem(answer, 403, "forbidden")
                assert "no such" not in told["detail"]
                assert "insufficient_scope" in answer.headers["www-authenticate"]


def test_the_collection_of_a_call_without_a_name(running: Running) -> None:
    with client_of(running, ONE) as one, client_of(running, READER) as reader, client_of(running, TWO) as two:
        assert names(one) == ["in-a.off"]
        assert names(reader) == []
        told = assert_problem(two.get("/shapes"), 422, "bad-request-fields")
        assert "a, b" in told["detail"]
        assert_problem(reader.get("/shapes", params={PARAMETER: "never-made"}), 404, "collection-not-found")


def test_a_limited_key_changes_no_collection_and_sees_nothing_of_the_whole(running: Running) -> None:
    for key in (ONE, TWO):
        with client_of(running, key) as client:
            for method in ("PUT", "DELETE"):
                assert_problem(client.request(method, "/collections/a"), 403, "forbidden")
            assert_problem(client.get("/metrics"), 403, "forbidden")
            assert client.get("/version").json()["pending"] is None
    with client_of(running, READER) as reader:
        sent = reader.delete("/shapes/x", params={PARAMETER: "b"})
        assert_problem(sent, 403, "forbidden")


def test_a_shape_moves_between_collections_of_its_key_only(running: Running) -> None:
    with client_of(running, ONE) as one, client_of(running, TWO) as two:
        (shape,) = one.get("/shapes").json()["shapes"]
        address = f"/shapes/{shape['id']}"
        for name in ("b", "default", "never-made"):
            assert_problem(one.patch(address, json={"collection": name}), 403, "forbidden")
        assert names(one) == ["in-a.off"]
        for own, other in (("a", "b"), ("b", "a")):
            moved = two.patch(address, params={PARAMETER: own}, json={"collection": other})
            assert moved.status_code == 200, moved.text
        assert names(one) == ["in-a.off"]


def test_a_signed_in_browser_has_the_limits_of_its_key(running: Running) -> None:
    with httpx.Client(base_url=running.client.base_url, timeout=60) as browser:
        assert browser.post("/session", headers={"x-api-key": ONE}).json()["signed_in"]
        assert names(browser) == names(browser, collection="a") == ["in-a.off"]
        assert_problem(browser.get("/shapes", params={PARAMETER: "b"}), 403, "forbidden")
        assert [one["name"] for one in browser.get("/collections").json()["collections"]] == ["a"]
        assert_problem(browser.put("/collections/c"), 403, "forbidden")


def test_entries_are_read_as_they_are_written() -> None:
    for text in (D, f"{D}:a", f"{D}:a+b-c_9+default"):
        assert KeyEntry.read(text).write() == text
    assert KeyEntry.read(f" {'AB' * 32}:b+a ") == KeyEntry("ab" * 32, frozenset({"a", "b"}))
    for wrong in ("", D[1:], f"{D}:", f"{D}:a+", f"{D}:A", f"{D}:a b", f"{D}:a:b", f"{D}+a", f":{D}"):
        with pytest.raises(ValueError, match="digest:name"):
            KeyEntry.read(wrong)


def test_a_key_in_both_lists_is_full() -> None:
    both = digest_of("both")
    ring = KeyRing(full=[f"{both}:a"], read=[both])
    assert ring.grant("both") == Grant("full", both, collections=frozenset({"a"}))


def test_a_key_stands_in_a_list_with_one_limit() -> None:
    assert Settings(api_keys=f"{D}:a,{D}:a").api_keys == (f"{D}:a", f"{D}:a")
    assert Settings(api_keys=f"{D.upper()}:b+a").api_keys == (f"{D}:a+b",)
    for wrong in (f"{D}:a,{D}", f"{D}:a,{D}:b", f"{D}:A", f"{D}:a;b"):
        with pytest.raises(ValueError, match="digest"):
            Settings(api_keys=wrong)
