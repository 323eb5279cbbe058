"""The answer in a collection is what it would be if only its shapes were stored."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from tests.service.engines import POSTGRESQL, SQLITE, using
from tests.service.support import Running, query, serving, settings_in, small_file, working_in

FEW, MANY = range(5), range(3, 9)
"""The meshes of either collection, two of which lie in both; the first has less than half of the shapes."""

WAYS: dict[str, dict[str, Any]] = {
    "shortlisted": {"top_k": 2},
    "exhaustive": {"top_k": 100, "exhaustive": True},
    "of a tag": {"top_k": 100, "tag": "even"},
    "by the chance": {"top_k": 5, "rank_by": "combined"},
    "of one size": {"top_k": 100, "scale": "respect"},
    "of a part": {"top_k": 100, "partial": True},
    "with points": {"top_k": 2, "correspondences": True},
}


@pytest.fixture(
    scope="module", params=[(SQLITE, "memory"), (POSTGRESQL, "database")], ids=["memory", "postgresql"]
)
def answers(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[tuple[str, str], Any]]:
    """The answers by collection and way; "alone" behind its name is without the other collection."""
    engine, signatures = request.param
    limits = {"shortlist_from": 5, "shortlist_length": 4, "finalists": 2}
    with ExitStack() as stack:
        stack.enter_context(using(engine))
        settings = settings_in(tmp_path_factory.mktemp("answers"), signatures=signatures, **limits)
        running = stack.enter_context(serving(settings))
        few, many = (stack.enter_context(working_in(running, name)) for name in ("few", "many"))
        found: dict[tuple[str, str], Any] = {}
        fill(many, MANY)
        ask(many, "many alone", found)
        fill(few, FEW)
        ask(many, "many", found)
        ask(few, "few", found)
        many.clear()
        ask(few, "few alone", found)
        yield found


def fill(own: Running, numbers: range) -> None:
    for number in numbers:
        own.store(small_file(number), f"{number}.off", tags="even" if number % 2 == 0 else "odd")


def ask(own: Running, name: str, found: dict[tuple[str, str], Any]) -> None:
    # A mesh that lies in both, and one that lies in neither, whose embedding takes the most time.
    shape_id = own.client.get("/shapes", params={"name": "4.off"}).json()["shapes"][0]["id"]
    for way, fields in WAYS.items():
        both = {"shape_id": shape_id, "exclude_self": False, **fields}
        found[name, way] = [told(own.client.post("/query", json=both).json())]
    found[name, "shortlisted"].append(told(query(own.client, small_file(40), **WAYS["shortlisted"]).json()))
    found[name, "by id"] = told(own.client.post("/query", json={"shape_id": shape_id, "top_k": 100}).json())
    found[name, "duplicates"] = told(own.client.get("/duplicates", params={"variants": True}).json())
    found[name, "list"] = own.client.get("/shapes", params={"limit": 500}).json()


def told(answer: dict[str, Any]) -> dict[str, Any]:
    """All but the times."""
    assert "milliseconds" in answer, answer
    return {key: value for key, value in answer.items() if key != "milliseconds"}


@pytest.mark.parametrize("way", [*WAYS, "by id", "duplicates", "list"])
@pytest.mark.parametrize(("name", "stored"), [("few", len(FEW)), ("many", len(MANY))])
def test_the_other_collection_changes_nothing(
    answers: dict[tuple[str, str], Any], name: str, stored: int, way: str
) -> None:
    assert answers[name, way] == answers[f"{name} alone", way]
    if way in WAYS:
        for answer in answers[name, way]:
            assert answer["stored"] == stored
            assert answer["results"]
    if way == "shortlisted":
        assert {answer["compared"] for answer in answers[name, way]} == {4}
    if way == "exhaustive":
        assert {answer["compared"] for answer in answers[name, way]} == {stored}


def test_a_mesh_in_both_is_two_shapes_on_one_file(answers: dict[tuple[str, str], Any]) -> None:
    pair = [
        next(shape for shape in answers[name, "list"]["shapes"] if shape["name"] == "4.off")
        for name in ("few", "many")
    ]
    assert pair[0]["sha256"] == pair[1]["sha256"]
    assert pair[0]["id"] != pair[1]["id"]
