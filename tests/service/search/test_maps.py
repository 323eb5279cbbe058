"""GET /map: positions of the stored shapes."""

import pytest

from core.gallery import make_shape
from core.io import write_mesh
from service.search import answer
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file


def test_an_empty_collection_has_an_empty_map(service: Running) -> None:
    assert service.client.get("/map").json() == {"shapes": [], "size": 0, "total": 0}


def test_similar_shapes_are_near_each_other(service: Running) -> None:
    labels = ("fish", "glasses", "hand")
    for label in labels:
        for pose in range(4):
            service.store(write_mesh(make_shape(label, pose), "ply"), f"{label}-{pose}.ply", tags=label)
    found = service.client.get("/map").json()
    shapes = found["shapes"]
    assert [shape["name"] for shape in shapes] == [
        f"{label}-{pose}.ply" for label in labels for pose in range(4)
    ]
    assert found["total"] == 12
    assert len({(shape["column"], shape["row"]) for shape in shapes}) == 12
    for one in shapes:
        others = [other for other in shapes if other is not one]
        nearest = min(others, key=lambda other: (other["x"] - one["x"]) ** 2 + (other["y"] - one["y"]) ** 2)
        assert nearest["name"][:4] == one["name"][:4], (one, nearest)
    fish = service.client.get("/map", params={"tag": "fish"}).json()
    assert [shape["name"] for shape in fish["shapes"]] == [f"fish-{pose}.ply" for pose in range(4)]
    assert fish["total"] == 4


@on_both
def test_a_map_of_many_shapes_has_some_of_them_evenly(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answer, "MOST_MAPPED", 5)
    for number in range(10):
        service.store(small_file(number % 3), name=f"ball-{number}")
    found = service.client.get("/map").json()
    assert [shape["name"] for shape in found["shapes"]] == [f"ball-{number}" for number in (0, 2, 4, 6, 8)]
    assert found["total"] == 10


def test_a_changed_shape_changes_the_map_at_once(service: Running) -> None:
    first = service.store(small_file(0), name="one")
    service.store(small_file(1), name="two")
    assert len(service.client.get("/map").json()["shapes"]) == 2
    service.client.patch(f"/shapes/{first['id']}", json={"name": "first"})
    service.store(small_file(2), name="three")
    names = [shape["name"] for shape in service.client.get("/map").json()["shapes"]]
    assert names == ["first", "two", "three"]
    assert_problem(service.client.get("/map?metadata=x"), 422, "bad-request-fields")
