"""GET /map: positions of the stored shapes."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from core.io import write_mesh
from service.collection import CollectionNumber
from service.container import Container
from service.errors import ShapeNotFoundError
from service.search import map
from service.search.endpoints import MISSING
from service.search.schemas import MOST_MAPPED
from tests.core.shapes import box
from tests.gallery import make_shape
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file


def sheet_of(service: Running, **filters: str) -> Image.Image:
    """The sheet of a map, once nothing is missing."""
    for _ in range(20):
        answer = service.client.get("/map/thumbnails.png", params=filters)
        assert answer.status_code == 200, answer.text
        if answer.headers[MISSING] == "0":
            assert (
                answer.headers["etag"]
                == f'"{service.client.get("/map", params=filters).json()["version"]}-0"'
            )
            return Image.open(BytesIO(answer.content)).convert("RGBA")
    raise AssertionError("pictures are still missing")


def test_an_empty_collection_has_an_empty_map(service: Running) -> None:
    found = service.client.get("/map").json()
    assert (found["shapes"], found["size"], found["total"]) == ([], 0, 0)
    assert sheet_of(service).size == (1, 1)


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
    monkeypatch.setattr(map, "MOST_MAPPED", 5)
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


@on_both
def test_the_sheet_of_a_map_has_the_picture_of_each_shape_in_its_cell(service: Running) -> None:
    for number, sides in enumerate([(1, 1, 1), (9, 2, 1), (1, 9, 1), (2, 2, 9), (9, 9, 1)]):
        service.store(write_mesh(box(*sides), "off"), f"{number}.off", tags="odd" if number % 2 else "even")
    for filters in ({}, {"tag": "even"}):
        found = service.client.get("/map", params=filters).json()
        picture = sheet_of(service, **filters)
        side = picture.width // found["size"]
        for i, shape in enumerate(found["shapes"]):
            x, y = i % found["size"] * side, i // found["size"] * side
            cell = np.asarray(picture.crop((x, y, x + side, y + side)), dtype=float)
            answer = service.client.get(f"/shapes/{shape['id']}/thumbnail.png", params={"size": str(side)})
            alone = np.asarray(Image.open(BytesIO(answer.content)).convert("RGBA"), dtype=float)
            assert np.abs(cell - alone)[..., 3].mean() < 1.0, shape["name"]
            assert np.abs(cell - alone)[alone[..., 3] == 255].mean() < 4.0, shape["name"]
    tag = f'"{service.client.get("/map").json()["version"]}-0"'
    known = service.client.get("/map/thumbnails.png", headers={"If-None-Match": tag})
    assert (known.status_code, known.content, known.headers["etag"]) == (304, b"", tag)
    service.store(small_file(7), "new.off")
    assert service.client.get("/map/thumbnails.png", headers={"If-None-Match": tag}).status_code == 200


def test_a_request_draws_for_a_time_and_what_cannot_be_drawn_stays_transparent(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = [service.store(small_file(number), f"{number}.off") for number in range(4)]
    with monkeypatch.context() as context:
        context.setattr(map, "DRAWING_SECONDS", -1.0)
        answer = service.client.get("/map/thumbnails.png")
    assert answer.headers[MISSING] == "4"
    assert answer.headers["etag"].endswith('-4"')
    assert not np.asarray(Image.open(BytesIO(answer.content)).convert("RGBA"))[..., 3].any()
    draw_stored = map.draw_stored

    async def draw(container: Container, collection: CollectionNumber, shape_id: str, *more: Any) -> bytes:
        if shape_id == stored[1]["id"]:
            raise ShapeNotFoundError(shape_id)
        return await draw_stored(container, collection, shape_id, *more)

    with monkeypatch.context() as context:
        context.setattr(map, "draw_stored", draw)
        answer = service.client.get("/map/thumbnails.png")
    assert (answer.headers[MISSING], answer.headers["etag"][-3:]) == ("0", '-1"')
    sheet_of(service)


def test_a_sheet_of_many_shapes_is_bounded() -> None:
    assert map.MOST_COLUMNS * 128 <= 3_072
    assert np.ceil(np.sqrt(MOST_MAPPED)) * 64 <= 3_072
