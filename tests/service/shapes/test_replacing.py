"""Another file in the place of a shape's own."""

import httpx

from service.client import Client
from service.storage.tables import BlobRow, EmbeddingRow
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file

pytestmark = on_both


def put(running: Running, shape_id: str, data: bytes, name: str = "a.off", **headers: str) -> httpx.Response:
    return running.client.put(f"/shapes/{shape_id}/file", files={"file": (name, data)}, headers=headers)


def nearest(running: Running, data: bytes) -> str:
    answer = running.client.post(
        "/query", files={"file": ("query.off", data)}, data={"exclude_self": "false"}
    ).json()
    return str(answer["results"][0]["shape"]["name"])


def test_the_shape_is_of_the_new_file_and_keeps_the_rest(service: Running) -> None:
    other = service.store(small_file(3), name="other.off")
    shape = service.store(small_file(1), "bird.off", tags="b,a", metadata='{"year": 2024}')
    assert nearest(service, small_file(1)) == "bird.off"
    answer = put(service, shape["id"], small_file(2, "stl"), "anything.stl")
    assert answer.status_code == 200
    replaced = answer.json()
    assert {key for key in shape if shape[key] != replaced[key]} <= {
        "format",
        "bytes",
        "sha256",
        "facts",
        "updated_at",
    }
    assert replaced["format"] == "stl"
    assert replaced == service.client.get(f"/shapes/{shape['id']}").json()
    file = service.client.get(f"/shapes/{shape['id']}/file")
    assert file.content == small_file(2, "stl")
    assert file.headers["etag"] == answer.headers["etag"] == f'"{replaced["sha256"]}"'
    assert nearest(service, small_file(2)) == "bird.off"
    assert service.client.get("/shapes").json()["shapes"][0]["id"] == other["id"]
    assert service.rows(BlobRow) == service.rows(EmbeddingRow) == 2


def test_bytes_that_another_shape_has_stay(service: Running) -> None:
    one = service.store(small_file(1), name="one.off")
    two = service.store(small_file(1), name="two.off")
    assert put(service, one["id"], small_file(2)).status_code == 200
    assert service.client.get(f"/shapes/{two['id']}/file").content == small_file(1)
    assert put(service, one["id"], small_file(1)).json()["facts"] == two["facts"]
    assert service.rows(BlobRow) == service.rows(EmbeddingRow) == 1
    service.client.patch(f"/shapes/{one['id']}", json={"name": "x.off"})
    again = put(service, one["id"], small_file(1)).json()
    assert again == service.client.get(f"/shapes/{one['id']}").json()


def test_the_name_is_taken_where_another_shape_has_both(service: Running) -> None:
    one = service.store(small_file(1), name="bird.off")
    service.store(small_file(2), name="bird.off")
    assert_problem(put(service, one["id"], small_file(2)), 409, "name-taken")
    assert service.client.get(f"/shapes/{one['id']}/file").content == small_file(1)


def test_only_the_file_that_is_meant_is_replaced(service: Running) -> None:
    with Client(str(service.client.base_url)) as client:
        shape = client.upload(("bird.off", small_file(1))).shape
        first = client.replace_file(shape.id, ("bird.off", small_file(2)), if_sha256=shape.sha256)
        assert_problem(
            put(service, shape.id, small_file(3), **{"If-Match": f'"{shape.sha256}"'}), 412, "file-changed"
        )
        assert client.shape(shape.id) == first
        weak = {"If-Match": f'W/"{first.sha256}"'}
        assert_problem(put(service, shape.id, small_file(3), **weak), 412, "file-changed")
        assert put(service, shape.id, small_file(3), **{"If-Match": "*"}).status_code == 200


def test_a_file_that_cannot_be_used_changes_nothing(service: Running) -> None:
    shape = service.store(small_file(1), name="bird.off")
    assert_problem(put(service, shape["id"], b"OFF\n"), 422, "malformed-mesh")
    assert_problem(put(service, shape["id"], small_file(1), "a.txt"), 415, "unknown-format")
    more = service.client.put(
        f"/shapes/{shape['id']}/file", files={"file": ("a.off", small_file(2))}, data={"name": "new"}
    )
    assert_problem(more, 422, "bad-request-fields")
    assert_problem(service.client.put(f"/shapes/{shape['id']}/file"), 415, "unsupported-media-type")
    assert service.client.get(f"/shapes/{shape['id']}").json() == shape
