"""Facets: each count is the total of the list in which its value is chosen."""

from collections.abc import Iterator
from typing import Any

import pytest

from core.io import write_mesh
from tests.core.shapes import box
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, working_in

pytestmark = on_both

SIDES = (0.4, 1.0, 10.0, 20.0, 20.1, 50.0, 700.0)
TAGS = ("even,Äpfel", "odd")


@pytest.fixture(scope="module")
def stocked(shared: Running) -> Iterator[Running]:
    """Boxes of several lengths, half of them in each format, and two in another collection."""
    shared.clear()
    for number, side in enumerate(SIDES):
        format = ("off", "stl")[number % 2]
        data = write_mesh(box(side, 0.5 * side, 0.2 * side), format)
        fields = {"tags": TAGS[number % 2], "metadata": '{"kind": "box"}' if number < 4 else "{}"}
        shared.store(data, f"box {number}.{format}", **fields)
    with working_in(shared, "other") as other:
        for number in (0, 2):
            other.store(write_mesh(box(1, 2, 3), "off"), f"box {number}.off")
        yield shared
        other.clear()
    shared.client.delete("/collections/other")


def facets(running: Running, **params: Any) -> dict[str, Any]:
    answer = running.client.get("/facets", params=params)
    assert answer.status_code == 200, answer.text
    return answer.json()


def total(running: Running, **params: Any) -> int:
    return running.client.get("/shapes", params=params).json()["total"]


FILTERS: list[dict[str, Any]] = [
    {},
    {"tag": "even"},
    {"name": "BOX 2"},
    {"metadata": "kind=box"},
    {"file_format": "stl"},
    {"length": "1..20"},
    {"area": "..5", "file_format": "off"},
    {"volume": "1..", "tag": "odd", "length": "5.."},
    {"tag": "nothing"},
]


@pytest.mark.parametrize("filters", FILTERS, ids=str)
def test_a_count_is_the_total_of_the_list_with_its_value(stocked: Running, filters: dict[str, Any]) -> None:
    found = facets(stocked, **filters)
    assert found["total"] == total(stocked, **filters)
    chosen = {"formats": "file_format", "lengths": "length", "collections": "collection"}
    for facet, parameter in chosen.items():
        for entry in found[facet]:
            assert entry["count"] == total(stocked, **{**filters, parameter: entry["value"]}), entry
    for entry in found["tags"]:
        tags = [tag for tag in (filters.get("tag"), entry["value"]) if tag]
        assert entry["count"] == total(stocked, **{**filters, "tag": tags}), entry
    without_length = {name: value for name, value in filters.items() if name != "length"}
    assert sum(band["count"] for band in found["lengths"]) == total(stocked, **without_length)


def test_facets_of_all_shapes(stocked: Running) -> None:
    found = facets(stocked)
    assert [tuple(entry.values()) for entry in found["tags"]] == [("even", 4), ("Äpfel", 4), ("odd", 3)]
    assert [tuple(entry.values()) for entry in found["formats"]] == [("off", 4), ("stl", 3)]
    assert [(band["least"], band["greatest"], band["count"]) for band in found["lengths"]] == [
        (0.2, 0.5, 1), (0.5, 1.0, 1), (5.0, 10.0, 1), (10.0, 20.0, 1), (20.0, 50.0, 2), (500.0, 1000.0, 1),
    ]  # fmt: skip
    assert found["collections"] == [{"value": "default", "count": 7}, {"value": "other", "count": 2}]


def test_tags_are_completed_and_bounded(stocked: Running) -> None:
    assert [tag["value"] for tag in facets(stocked, tag_text="äp")["tags"]] == ["Äpfel"]
    found = facets(stocked, limit=2)
    assert ([tag["value"] for tag in found["tags"]], found["distinct_tags"]) == (["even", "Äpfel"], 3)
    for wrong in ({"limit": 0}, {"limit": 1001}, {"file_format": "dwg"}, {"length": "wide"}):
        assert_problem(stocked.client.get("/facets", params=wrong), 422, "bad-request-fields")


def test_deleted_shapes_do_not_count(stocked: Running) -> None:
    one = stocked.store(write_mesh(box(3, 2, 1), "off"), "gone.off", tags="gone")
    assert facets(stocked, tag="gone")["total"] == 1
    stocked.client.delete(f"/shapes/{one['id']}")
    assert facets(stocked, tag_text="gone")["tags"] == []
    assert facets(stocked)["total"] == len(SIDES)
