"""Sizes: the measurements of records, the filters by them, and unit mistakes."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.client import Client, ClientError
from tests.core.shapes import blob, box, joined, rectangle, scaled, subdivided, turned
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, query


def fine(mesh: Mesh) -> Mesh:
    for _ in range(3):
        mesh = subdivided(mesh)
    return mesh


MESHES = {
    "cube.off": turned(fine(box(20.0, 20.0, 20.0)), 1),
    "bar.off": turned(fine(box(100.0, 20.0, 10.0)), 2),
    "sheet.off": turned(rectangle(30.0, 40.0, 9, 9), 3),
}


@pytest.fixture(scope="module")
def stocked(shared: Running) -> Iterator[Running]:
    shared.clear()
    for name, mesh in MESHES.items():
        shared.store(write_mesh(mesh, "off"), name)
    yield shared
    shared.clear()


def listed(running: Running, **filters: str) -> set[str]:
    answer = running.client.get("/shapes", params=filters).json()
    assert answer["total"] == len(answer["shapes"])
    return {shape["name"] for shape in answer["shapes"]}


def test_records_have_bounding_boxes_an_area_and_a_volume(stocked: Running) -> None:
    shapes = {shape["name"]: shape["facts"] for shape in stocked.client.get("/shapes").json()["shapes"]}
    bar, sheet = shapes["bar.off"], shapes["sheet.off"]
    assert bar["bounding_box"] == pytest.approx([100.0, 20.0, 10.0], rel=1e-4)
    assert bar["area"] == pytest.approx(2 * (2000 + 1000 + 200), rel=1e-4)
    assert (bar["volume"], bar["closed"]) == (pytest.approx(20_000.0, rel=1e-4), True)
    assert shapes["cube.off"]["bounding_box"] == pytest.approx([20.0, 20.0, 20.0], rel=1e-4)
    assert sheet["bounding_box"] == pytest.approx([40.0, 30.0, 0.0], abs=1e-3)
    assert bar["file_box"] == pytest.approx(np.ptp(MESHES["bar.off"].vertices, axis=0), rel=1e-4)
    assert sheet["closed"] is False


def test_an_answer_has_the_measures_of_its_query(stocked: Running) -> None:
    shapes = stocked.client.get("/shapes").json()["shapes"]
    for shape in shapes:
        measured = {"facts": shape["facts"], "unit": shape["unit"]}
        assert stocked.client.post("/query", json={"shape_id": shape["id"]}).json()["query"] == measured
    fine_bar = query(stocked.client, write_mesh(MESHES["bar.off"], "3mf"), "bar.3mf").json()["query"]
    assert fine_bar["unit"] == "mm"
    assert fine_bar["facts"]["bounding_box"] == pytest.approx([100.0, 20.0, 10.0], rel=1e-4)


@on_both
@pytest.mark.parametrize(
    ("filters", "expected"),
    [
        ({"length": "30..60"}, ["sheet.off"]),
        ({"length": "50.."}, ["bar.off"]),
        ({"length": "..39.9"}, ["cube.off"]),
        ({"area": "1.3e3..2400.1"}, ["cube.off"]),
        ({"area": "0..1e9"}, sorted(MESHES)),
        ({"volume": "7999..8001"}, ["cube.off"]),
        # An open surface has no volume, whatever its sum.
        ({"volume": "0.."}, ["bar.off", "cube.off"]),
        ({"volume": "..10000", "length": "..30"}, ["cube.off"]),
        ({"length": "1000..2000"}, []),
    ],
    ids=str,
)
def test_lists_and_searches_choose_by_size(
    stocked: Running, filters: dict[str, str], expected: list[str]
) -> None:
    assert sorted(listed(stocked, **filters)) == expected
    data = write_mesh(MESHES["bar.off"], "off")
    answer = query(stocked.client, data, **filters).json()
    assert sorted(result["shape"]["name"] for result in answer["results"]) == expected
    assert answer["compared"] == len(expected)
    bar = stocked.client.get("/shapes", params={"name": "bar"}).json()["shapes"][0]["id"]
    asked = {"shape_id": bar, "exclude_self": False, **filters}
    again = stocked.client.post("/query", json=asked).json()
    assert sorted(result["shape"]["name"] for result in again["results"]) == expected


WRONG_RANGES = ["5", "..", "a..b", "-1..2", "1...2", "3..2", "1..nan", "1,5..2", "1..2\n", " 1..2", "1..inf"]


def test_a_wrong_range_is_refused(stocked: Running) -> None:
    ranges = [("area", wrong) for wrong in WRONG_RANGES] + [("volume", ".."), ("length", "..")]
    for field, wrong in ranges:
        answers = [stocked.client.get("/shapes", params={field: wrong})]
        if wrong == "..":
            data = write_mesh(MESHES["bar.off"], "off")
            answers.append(query(stocked.client, data, **{field: wrong}))
            answers.append(stocked.client.get("/duplicates", params={field: wrong}))
        for answer in answers:
            problem = assert_problem(answer, 422, "bad-request-fields")
            assert [error["field"] for error in problem["errors"]] == [field]
            assert "min..max" in problem["detail"] or "exceeds the greatest" in problem["detail"]


@on_both
def test_the_tolerance_of_sizes_is_the_clients_to_choose(stocked: Running) -> None:
    data = write_mesh(scaled(MESHES["bar.off"], 1.25), "off")
    for tolerance, expected in ((None, []), (0.2, []), (0.3, ["bar.off"])):
        more = {} if tolerance is None else {"size_tolerance": tolerance}
        answer = query(stocked.client, data, scale="respect", **more).json()
        assert [result["shape"]["name"] for result in answer["results"]] == expected


def test_results_tell_the_size_over_that_of_the_query(stocked: Running) -> None:
    data = write_mesh(scaled(MESHES["bar.off"], 0.25), "off")
    ratios = {
        result["shape"]["name"]: result["size_ratio"]
        for result in query(stocked.client, data).json()["results"]
    }
    assert ratios["bar.off"] == pytest.approx(4.0, rel=1e-4)
    assert ratios["cube.off"] == pytest.approx(4.0 * (2400 / 6400) ** 0.5, rel=0.05)


@pytest.mark.parametrize(
    ("factor", "times"),
    [(1 / 25.4, " 25.4 times"), (25.4, " 1/25.4 times"), (0.1, " 10 times"), (1000, " 1/1000 times")],
)
def test_a_unit_mistake_is_told(stocked: Running, factor: float, times: str) -> None:
    data = write_mesh(scaled(MESHES["bar.off"], factor), "off")
    answer = query(stocked.client, data, scale="respect").json()
    assert answer["results"] == []
    (warning,) = answer["warnings"]
    assert f"{times} as large" in warning
    assert "'bar.off'" in warning
    assert "units" in warning
    assert query(stocked.client, data).json()["warnings"] == []


@on_both
def test_a_unit_mistake_in_a_range_is_told(stocked: Running) -> None:
    bar = stocked.client.get("/shapes", params={"name": "bar"}).json()["shapes"][0]["id"]
    asked: dict[str, Any] = {"shape_id": bar, "exclude_self": False, "length": "3.5..4.5"}
    (warning,) = stocked.client.post("/query", json=asked).json()["warnings"]
    assert "1 shape is 25.4 times as large" in warning


@pytest.mark.parametrize("sizes", [{"scale": "respect"}, {"length": "1000000..2000000"}])
def test_no_unit_mistake_is_told_where_there_is_none(stocked: Running, sizes: dict[str, str]) -> None:
    data = write_mesh(scaled(MESHES["bar.off"], 2.7), "off")
    answer = query(stocked.client, data, **sizes).json()
    assert (answer["results"], answer["warnings"]) == ([], [])


def test_the_client_filters_by_size_and_by_metadata_as_it_was_uploaded(service: Running) -> None:
    metadata = {"maker": "A", "year": 2024, "checked": True, "none": None, "list": [1]}
    parts = {"two blobs.off": joined(blob(1), scaled(blob(2), 0.3)), "blob.off": scaled(blob(1), 5.0)}
    with Client(str(service.client.base_url)) as client:
        for name, mesh in parts.items():
            client.upload((name, write_mesh(mesh, "off")), metadata={**metadata, "name": name})
        file = ("x.off", write_mesh(parts["blob.off"], "off"))
        scalars = {key: value for key, value in metadata.items() if key != "list"}
        for wanted in ({**scalars, "name": "blob.off"}, ["year=2024", "name=blob.off"]):
            answer = client.query_file(file, metadata=wanted)
            assert [result.shape.name for result in answer.results] == ["blob.off"]
            assert [shape.name for shape in client.shapes(metadata=wanted)] == ["blob.off"]
            own = answer.results[0].shape
            found = client.query_shape(own.id, metadata=wanted, exclude_self=False)
            assert [result.shape.id for result in found.results] == [own.id]
            assert client.duplicates(metadata=wanted).groups == []
        length = (own.facts.bounding_box or [0.0])[0]
        near = f"{0.9 * length}..{1.1 * length}"
        assert [shape.name for shape in client.shapes(length=near)] == ["blob.off"]
        assert client.page(length=near).total == 1
        for unknown in ({"list": [1]}, {"a=b": "c"}):
            with pytest.raises(ClientError, match="no filter can name"):
                client.query_file(file, metadata=unknown)
