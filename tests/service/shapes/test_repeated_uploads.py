"""The same file under the same name again: its tags and metadata join those of the stored shape."""

from typing import Any

import pytest

from service.shapes.fields import METADATA_KEYS, TAGS
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file, upload

pytestmark = on_both


def again(service: Running, **fields: str) -> dict[str, Any]:
    answer = upload(service.client, small_file(0), "part.off", **fields)
    assert answer.status_code == 200
    stored = answer.json()
    read = service.client.get(f"/shapes/{stored['id']}").json()
    assert stored == {**read, "created": False, "changed": stored["changed"]}
    return stored


def test_tags_are_added_and_keys_of_metadata_replaced(service: Running) -> None:
    first = upload(service.client, small_file(0), "part.off", tags="b,a", metadata='{"rev": 1, "by": "x"}')
    assert (first.status_code, first.json()["created"], first.json()["changed"]) == (201, True, [])
    same = again(service, tags="a", metadata='{"by": "x"}')
    assert (same["changed"], same["updated_at"]) == ([], first.json()["updated_at"])
    tagged = again(service, tags="c,a")
    assert (tagged["changed"], tagged["tags"]) == (["tags"], ["b", "a", "c"])
    assert tagged["metadata"] == {"rev": 1, "by": "x"}
    described = again(service, metadata='{"rev": true, "new": null}')
    assert described["changed"] == ["metadata"]
    assert described["metadata"] == {"rev": True, "by": "x", "new": None}
    assert described["metadata"]["rev"] is True
    assert again(service, tags="d", metadata='{"rev": 2}')["changed"] == ["tags", "metadata"]
    found = service.client.get("/shapes", params={"tag": "c,d", "metadata": "rev=2"}).json()
    assert [shape["id"] for shape in found["shapes"]] == [first.json()["id"]]


@pytest.mark.parametrize("field", ["tags", "metadata"])
def test_more_than_a_shape_may_have_is_refused_whole(service: Running, field: str) -> None:
    tags = ",".join(f"t{number}" for number in range(TAGS))
    metadata = "{" + ",".join(f'"k{number}": 0' for number in range(METADATA_KEYS)) + "}"
    first = service.store(small_file(0), "part.off", tags=tags, metadata=metadata)
    more = {"tags": "one more"} if field == "tags" else {"metadata": '{"one more": 0}'}
    answer = upload(service.client, small_file(0), "part.off", **more)
    assert assert_problem(answer, 422, "bad-request-fields")["errors"][0]["field"] == field
    read = service.client.get(f"/shapes/{first['id']}").json()
    assert (read["tags"], read["metadata"]) == (first["tags"], first["metadata"])


def test_another_name_or_another_file_is_another_shape(service: Running) -> None:
    first = service.store(small_file(0), "part.off", tags="a")
    assert upload(service.client, small_file(0), "other.off", tags="b").status_code == 201
    assert upload(service.client, small_file(1), "part.off", tags="b").status_code == 201
    assert service.client.get(f"/shapes/{first['id']}").json()["tags"] == ["a"]
