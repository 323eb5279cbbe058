"""Queries with many stored shapes, or files, at once."""

from collections.abc import Sequence
from typing import Any
from weakref import WeakSet

import pytest

from core.arrays import Float32s
from core.embedding import Scores
from core.parameters import Parameters
from service import turns
from service.app import FILE_BATCHES
from service.client import Client, ClientError
from service.container import Container
from service.http.problem_document import TYPE_PREFIX, Cause
from service.search import batch, scoring
from service.search.records import Query
from service.search.schemas import QueryAnswer
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file

pytestmark = on_both


def test_a_batch_answers_as_single_queries_do(service: Running) -> None:
    ids = [
        service.store(small_file(number), name=f"{number}.off", tags=f"t{number % 2}")["id"]
        for number in range(4)
    ]
    options: dict[str, Any] = {"top_k": 2, "rank_by": "combined", "tag": ["t0"]}
    batched = service.client.post("/query/batch", json={"shape_ids": ids, **options}).json()["answers"]
    for shape_id, answer in zip(ids, batched, strict=True):
        single = service.client.post("/query", json={"shape_id": shape_id, **options}).json()
        for one in (answer, single):
            del one["milliseconds"], one["warnings"]
        assert answer == single
    assert [len(answer["results"]) for answer in batched] == [1, 2, 1, 2]
    itself = service.client.post("/query/batch", json={"shape_ids": ids[:1], "exclude_self": False}).json()
    assert itself["answers"][0]["results"][0]["shape"]["id"] == ids[0]
    assert_problem(
        service.client.post("/query/batch", json={"shape_ids": [*ids, "no such id"]}), 404, "shape-not-found"
    )
    for wrong in ([], ids * 26):
        assert_problem(
            service.client.post("/query/batch", json={"shape_ids": wrong}), 422, "bad-request-fields"
        )


def test_pairs_of_a_batch_are_matched_once(service: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    ids = [service.store(small_file(number))["id"] for number in range(5)]
    matched: list[int] = []
    score = scoring.score_match_records

    def counted(query: Float32s, records: Sequence[Float32s], parameters: Parameters) -> Scores:
        matched.append(len(records))
        return score(query, records, parameters)

    monkeypatch.setattr(scoring, "score_match_records", counted)
    queries: WeakSet[Query] = WeakSet()
    left: list[int] = []

    async def searched(container: Container, query: Query, *about: Any, **options: Any) -> QueryAnswer:
        queries.add(query)
        left.append(len(queries))
        return await search(container, query, *about, **options)

    search = batch.search
    monkeypatch.setattr(batch, "search", searched)
    service.client.post("/query/batch", json={"shape_ids": ids}).raise_for_status()
    # Queries side by side may match a pair twice: those of two workers, and one ahead.
    assert 5 * 4 // 2 <= sum(matched) <= 5 * 4 - 3
    matched.clear()
    service.client.post("/query/batch", json={"shape_ids": ids[:1] * 20}).raise_for_status()
    assert sum(matched) == 20 * 4
    # Queries that are answered are gone, with their meshes, but for one that an idle thread may hold.
    assert left[-1] < 10


def test_a_batch_of_files_answers_as_single_queries_do_and_names_the_unusable_ones(service: Running) -> None:
    for number in range(3):
        service.store(small_file(number), name=f"{number}.off")
    names = {"a.off": small_file(0), "b.off": b"OFF", "c.xyz": small_file(1), "d.off": small_file(2)}
    files = [("file", each) for each in names.items()]
    options = {"top_k": "2", "exclude_self": "true"}
    answer = service.client.post("/query/batch", files=files, data=options)
    assert answer.status_code == 200, answer.text
    first, malformed, unknown, last = answer.json()["answers"]
    for batched, (_, file) in ((first, files[0]), (last, files[3])):
        single = service.client.post("/query", files={"file": file}, data=options).json()
        for one in (batched, single):
            del one["milliseconds"], one["warnings"]
        assert batched == single
        assert len(single["results"]) == 2
    kinds = [each["type"].removeprefix(TYPE_PREFIX) for each in (malformed, unknown)]
    assert kinds == ["malformed-mesh", "unknown-format"]
    with Client(str(service.client.base_url)) as client:
        told = client.query_batch([*names.items()], top_k=2, exclude_self=True).answers
        assert isinstance(told[0], QueryAnswer)
        assert told[0].results[0].shape.id == first["results"][0]["shape"]["id"]
        assert isinstance(told[1], Cause)
        with pytest.raises(ClientError, match="either"):
            client.query_batch(["id", ("a.off", b"")])
    many = [("file", (f"{number}.off", b"OFF")) for number in range(101)]
    assert service.client.post("/query/batch", files=many).status_code == 400
    assert_problem(service.client.post("/query/batch", files={"file": ("", b"")}), 422, "bad-request-fields")


def test_a_client_sends_few_batches_of_files_at_a_time(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(turns, "PATIENCE_SECONDS", 0.01)
    files = [("file", ("a.off", b"OFF"))]
    for _ in range(FILE_BATCHES + 1):
        assert service.client.post("/query/batch", files=files).status_code == 200
    monkeypatch.setattr(service.container.file_batches, "places", 0)
    assert_problem(service.client.post("/query/batch", files=files), 503, "busy")
    stored = service.client.post("/query/batch", json={"shape_ids": ["unknown"]})
    assert_problem(stored, 404, "shape-not-found")
