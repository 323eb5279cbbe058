"""Queries that leave something out, find nothing, or are refused."""

import httpx
import pytest
from sqlalchemy import select

from service.search import repository
from service.storage.tables import BlobRow, EmbeddingRow
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, query, small_file


def test_equals_are_in_the_order_they_were_stored(service: Running) -> None:
    ids = [service.store(small_file(0), name=f"copy {i}")["id"] for i in range(5)]
    for _ in range(2):
        results = query(service.client, small_file(0), top_k=5).json()["results"]
        assert [result["shape"]["id"] for result in results] == ids


@on_both
def test_the_query_itself_is_left_out_by_id_and_kept_by_file_unless_said(service: Running) -> None:
    itself = service.store(small_file(4), name="itself")["id"]
    copy = service.store(small_file(4), name="copy")["id"]
    other = service.store(small_file(5), name="other")["id"]

    def found(answer: httpx.Response) -> set[str]:
        assert answer.json()["stored"] == 3
        shapes = {result["shape"]["id"] for result in answer.json()["results"]}
        assert answer.json()["compared"] == len(shapes)
        return shapes

    assert found(service.client.post("/query", json={"shape_id": itself})) == {copy, other}
    with_itself = {"shape_id": itself, "exclude_self": False}
    assert found(service.client.post("/query", json=with_itself)) == {itself, copy, other}
    assert found(query(service.client, small_file(4))) == {itself, copy, other}
    assert found(query(service.client, small_file(4), exclude_self="true")) == {other}


def test_an_empty_archive_answers_with_nothing(service: Running) -> None:
    answer = query(service.client, small_file(20)).json()
    assert answer["results"] == []
    assert answer["matched"] is False
    assert (answer["compared"], answer["stored"]) == (0, 0)


def test_a_bad_option_in_the_address_is_refused_though_the_body_overrides_it(service: Running) -> None:
    shape = service.store(small_file(0))["id"]
    for body in (
        {"files": {"file": ("a.off", small_file(0))}, "data": {"top_k": 1}},
        {"json": {"shape_id": shape, "top_k": 1}},
    ):
        answer = service.client.post("/query", params={"top_k": "none"}, **body)
        problem = assert_problem(answer, 422, "bad-request-fields")
        assert [fault["field"] for fault in problem["errors"]] == ["top_k"]
        assert service.client.post("/query", params={"top_k": 2}, **body).status_code == 200


def test_other_bodies_are_refused(service: Running) -> None:
    for headers in ({"content-type": "text/plain"}, {"content-type": "application/octet-stream"}, {}):
        assert_problem(
            service.client.post("/query", content=b"OFF", headers=headers), 415, "unsupported-media-type"
        )


def test_a_bad_pair_is_refused(service: Running) -> None:
    assert_problem(service.client.post("/compare", json={"first": "a"}), 422, "bad-request-fields")
    pair = {"first": "a", "second": "b"}
    assert_problem(service.client.post("/compare", json=pair), 404, "shape-not-found")
    problem = assert_problem(
        service.client.post("/compare", json={**pair, "third": 1}), 422, "bad-request-fields"
    )
    assert problem["errors"][0]["field"] == "third"


@on_both
def test_a_damaged_embedding_is_left_out_and_not_given_out(
    service: Running, caplog: pytest.LogCaptureFixture
) -> None:
    """The last bit of a coordinate leaves a record readable."""
    damaged, _ = (service.store(small_file(number), name=str(number))["id"] for number in (1, 2))
    numbers = select(EmbeddingRow.number).order_by(EmbeddingRow.number)
    with service.container.database.write() as session:
        first, second = session.scalars(numbers).all()
        row = session.scalars(select(EmbeddingRow).where(EmbeddingRow.number == first)).one()
        row.record = row.record[:-1] + bytes([row.record[-1] ^ 1])
    with service.container.database.read() as session:
        assert list(repository.embedding_records(session, [first, second])) == [second]
    assert caplog.messages == [f"embedding {first} is damaged: it does not have its checksum"]
    assert_problem(service.client.get(f"/shapes/{damaged}/embedding"), 500, "bad-record")
    assert service.client.get(f"/shapes/{damaged}/file").content == small_file(1)


def test_a_damaged_file_is_not_given_out(service: Running) -> None:
    damaged = service.store(small_file(1))["id"]
    with service.container.database.write() as session:
        row = session.scalars(select(BlobRow)).one()
        row.data = row.data[:-1] + bytes([row.data[-1] ^ 1])
    for path in ("file", "file?format=stl", "thumbnail.png"):
        detail = assert_problem(service.client.get(f"/shapes/{damaged}/{path}"), 500, "bad-record")["detail"]
        assert "the stored file is damaged" in detail
    assert service.client.get(f"/shapes/{damaged}/embedding").status_code == 200
