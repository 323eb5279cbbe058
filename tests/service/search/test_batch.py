"""Queries with many stored shapes at once."""

from typing import Any

from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file

pytestmark = on_both


def test_a_batch_answers_as_single_queries_do(service: Running) -> None:
    ids = [
        service.store(small_file(number), name=f"{number}.off", tags=f"t{number % 2}")["id"]
        for number in range(4)
    ]
    options: dict[str, Any] = {"top_k": 2, "rank_by": "combined", "tag": ["t0"]}
    batch = service.client.post("/query/batch", json={"shape_ids": ids, **options}).json()["answers"]
    for shape_id, answer in zip(ids, batch, strict=True):
        single = service.client.post("/query", json={"shape_id": shape_id, **options}).json()
        for one in (answer, single):
            del one["milliseconds"], one["warnings"]
        assert answer == single
    assert [len(answer["results"]) for answer in batch] == [1, 2, 1, 2]
    itself = service.client.post("/query/batch", json={"shape_ids": ids[:1], "exclude_self": False}).json()
    assert itself["answers"][0]["results"][0]["shape"]["id"] == ids[0]
    assert_problem(
        service.client.post("/query/batch", json={"shape_ids": [*ids, "no such id"]}), 404, "shape-not-found"
    )
    for wrong in ([], ids * 26):
        assert_problem(
            service.client.post("/query/batch", json={"shape_ids": wrong}), 422, "bad-request-fields"
        )
