"""Signatures looked for by the database: the same shapes as by those in memory, and none in memory."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from core.arrays import Ints
from service.search import repository
from service.search.signature_index import MemoryIndex
from service.storage.postgresql import EF_SEARCH
from tests.service.engines import on_postgresql
from tests.service.support import Running, query, serving, settings_in, small_file, wait_until

pytestmark = on_postgresql

STORED = 40
FROM, LENGTH = 20, 12


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory, engine: str) -> Iterator[tuple[Running, Running]]:
    """Two services on one archive: by memory, and by the database."""
    limits = {"shortlist_from": FROM, "shortlist_length": LENGTH, "finalists": 2}
    settings = settings_in(tmp_path_factory.mktemp("stored"), workers=1, **limits)
    by_database = settings.model_copy(update={"signatures": "database"})
    with serving(settings) as memory, serving(by_database) as database:
        for number in range(STORED):
            tags = ["half"] if number % 2 else ["half", "few"] if number < 10 else []
            memory.store(small_file(number), f"{number}.off", tags=tags)
        yield memory, database


def answers(running: Running, data: bytes, **options: Any) -> dict[str, Any]:
    answer = query(running.client, data, **options)
    assert answer.status_code == 200, answer.text
    return {**answer.json(), "milliseconds": None}


@pytest.mark.parametrize(
    ("options", "compared"),
    [
        ({}, 2 + 3),
        ({"top_k": 6}, 2 + 6),
        ({"rank_by": "combined"}, 2 + 3),
        ({"tag": "half"}, 2 + 3),
        ({"tag": "few"}, 5),
        ({"exhaustive": "true", "top_k": 50}, STORED),
        ({"exhaustive": "true", "tag": "half", "top_k": 50}, STORED // 2 + 5),
    ],
)
def test_answers_are_those_of_memory(
    both: tuple[Running, Running], options: dict[str, Any], compared: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, database = both
    monkeypatch.setattr(MemoryIndex, "widening", 1)
    for number in (3, 7, 100, 101):
        expected = answers(memory, small_file(number), **options)
        assert answers(database, small_file(number), **options) == expected
        assert (expected["compared"], expected["stored"]) == (compared, STORED)


def test_a_stored_shape_is_left_out_or_found_as_with_memory(both: tuple[Running, Running]) -> None:
    (shape,) = both[0].client.get("/shapes", params={"name": "10.off"}).json()["shapes"]
    for itself in (True, False):
        body = {"shape_id": shape["id"], "exclude_self": itself, "top_k": 5}
        told = [{**each.client.post("/query", json=body).json(), "milliseconds": 0} for each in both]
        assert told[0] == told[1]
        assert (shape["id"] in {result["shape"]["id"] for result in told[1]["results"]}) != itself


def test_the_next_query_sees_stored_and_deleted_shapes(both: tuple[Running, Running]) -> None:
    memory, database = both
    new = memory.store(small_file(200), "new.off")
    first = answers(database, small_file(200))["results"][0]
    assert first["shape"]["id"] == new["id"]
    assert memory.client.delete(f"/shapes/{new['id']}").status_code == 204
    assert new["id"] not in {each["shape"]["id"] for each in answers(database, small_file(200))["results"]}


def test_no_signature_is_in_memory_and_rows_are_made_ready(both: tuple[Running, Running]) -> None:
    memory, database = both
    answers(memory, small_file(3))
    answers(database, small_file(3))
    told = [each.client.get("/metrics").text for each in both]
    assert [re.search(r"^isoshape_indexed_shapes (\S+)$", text, re.M)[1] for text in told] == ["40.0", "0.0"]  # type: ignore[index]
    wait_until(lambda: len(database.container.pipelines._active.cache) >= STORED, seconds=60)  # type: ignore[union-attr]


def test_the_graph_is_asked_where_there_is_no_filter(
    both: tuple[Running, Running], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int | None] = []
    nearest = repository.nearest

    def noted(*arguments: Any, ef_search: int | None, views: bool, **named: Any) -> Ints:
        if not views:
            asked.append(ef_search)
        return nearest(*arguments, ef_search=ef_search, views=views, **named)

    monkeypatch.setattr(repository, "nearest", noted)
    answers(both[1], small_file(3))
    answers(both[1], small_file(3), tag="half")
    assert asked == [EF_SEARCH, None]
