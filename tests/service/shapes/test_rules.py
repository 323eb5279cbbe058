"""Rules of a collection: shapes get tags by their metadata, those that are stored and those that come."""

from collections.abc import Iterator

import pytest

from tests.service.engines import on_both
from tests.service.jobs.support import ended, pack, send
from tests.service.support import Running, assert_problem, small_file

pytestmark = on_both


@pytest.fixture
def ruled(service: Running) -> Iterator[Running]:
    """The shared service, whose rules go at the end."""
    yield service
    assert service.client.put("/rules", json={"rules": {}}).status_code == 200


def test_rules_tag_what_is_stored_and_what_comes(ruled: Running) -> None:
    client, store = ruled.client, ruled.store

    def tags(shape: str, **params: str) -> list[str]:
        return list(client.get(f"/shapes/{shape}", params=params).json()["tags"])

    steel = store(small_file(0), name="a.off", metadata='{"material": "Steel 304", "drawn": true}')["id"]
    plain = store(small_file(1), name="b.off", tags="mine")["id"]
    rules = {"material=steel*": ["metal", "heavy"], "drawn=true": ["drawn"], "material=*": ["known", "metal"]}
    assert client.put("/rules", json={"rules": rules}).json() == {"rules": rules, "changed": 1}
    assert client.get("/rules").json() == {"rules": rules}
    assert (tags(steel), tags(plain)) == (["metal", "heavy", "drawn", "known"], ["mine"])
    assert client.get("/shapes", params={"q": "heavy"}).json()["total"] == 1

    # An upload, and one of a file that is stored; a job; changes of one shape and of many.
    new = store(small_file(2), name="c.off", tags="own", metadata='{"material": "STEEL"}')
    assert new["tags"] == ["own", "metal", "heavy", "known"]
    assert store(small_file(1), name="b.off", metadata='{"drawn": true}')["tags"] == ["mine", "drawn"]
    sent = send(client, pack({"d.off": small_file(3)}), metadata='{"material": "brass"}').json()["id"]
    assert ended(client, sent)["counts"]["stored"] == 1
    (brass,) = client.get("/shapes", params={"name": "d.off"}).json()["shapes"]
    assert brass["tags"] == ["known", "metal"]
    changes = {"tags": ["other"], "metadata": {"material": "steel"}}
    assert client.patch(f"/shapes/{plain}", json=changes).json()["tags"] == [
        "other",
        "metal",
        "heavy",
        "known",
    ]
    many = {"name": "d.off", "set_metadata": {"drawn": True}, "dry_run": False}
    assert client.patch("/shapes", json=many).json()["changed"] == 1
    assert tags(brass["id"]) == ["known", "metal", "drawn"]

    # Tags that a person takes away stay away, and tags of rules stay without the rules.
    assert client.patch(f"/shapes/{steel}", json={"tags": []}).json()["tags"] == []
    assert client.put("/rules", json={"rules": {}}).json()["changed"] == 0
    assert (tags(steel), tags(brass["id"])) == ([], ["known", "metal", "drawn"])


def test_a_rule_is_of_its_collection_and_gives_no_tag_too_many(ruled: Running) -> None:
    client = ruled.client
    client.put("/collections/ruled")
    of_ruled = {"params": {"collection": "ruled"}}
    client.put("/rules", json={"rules": {"k=v": [f"t{i}" for i in range(31)]}}, **of_ruled)
    full = ruled.store(small_file(0), name="full.off", tags="a,b", metadata='{"k": "v"}')["id"]
    room = ruled.store(small_file(1), name="room.off", tags="a", metadata='{"k": "v"}')["id"]
    assert client.get("/rules").json() == {"rules": {}}
    for shape, many in ((full, 2), (room, 32)):
        moved = client.patch(f"/shapes/{shape}", json={"collection": "ruled"}).json()
        assert len(moved["tags"]) == many
        deleted = client.delete(f"/shapes/{shape}", params={"permanent": True, "collection": "ruled"})
        assert deleted.status_code == 204
    client.put("/rules", json={"rules": {}}, **of_ruled)
    assert client.delete("/collections/ruled").status_code == 204


@pytest.mark.parametrize(
    "rules", [{"material": ["a"]}, {"=steel": ["a"]}, {"k=v": "a"}, {"k=v": ["a,b"]}, {"k\0=v": []}]
)
def test_wrong_rules_are_refused(service: Running, rules: dict[str, object]) -> None:
    assert_problem(service.client.put("/rules", json={"rules": rules}), 422, "bad-request-fields")
