"""Which shapes a query is compared with: one syntax for lists and searches."""

import hashlib
from typing import Any

import numpy as np
import pytest

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.search.schemas import SIZE_TOLERANCE
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, query, small_file

pytestmark = on_both

SHAPES = {
    "Äpfel 100%": {"tags": "animal"},
    "bird": {
        "tags": "animal,wings",
        "metadata": '{"source": "scan", "year": 2024, "maker": "A, B", "formula": "a=b", '
        '"deep": {"source": "scan"}}',
    },
    "chair": {"metadata": '{"source": "scan", "checked": true, "note": null, "ratio": 0.5, "maker": "A, B"}'},
    "washer": {},
}
FILTERS: list[tuple[dict[str, Any], set[str]]] = [
    ({"tag": "nothing"}, set()),
    ({"tag": "animal"}, {"Äpfel 100%", "bird"}),
    ({"tag": "animal,wings"}, {"bird"}),
    ({"tag": ["animal", "wings"]}, {"bird"}),
    ({"name": "BIRD"}, {"bird"}),
    ({"name": "äPFEL"}, {"Äpfel 100%"}),
    ({"name": "a\u0308pfel"}, {"Äpfel 100%"}),
    ({"name": "0%"}, {"Äpfel 100%"}),
    ({"name": "b_r"}, set()),
    ({"metadata": ["source=scan"]}, {"bird", "chair"}),
    ({"metadata": ["maker=A, B", "year=2024"]}, {"bird"}),
    ({"metadata": ["source=scan", "source=drawing"]}, set()),
    ({"metadata": ["source=scan"] * 32}, {"bird", "chair"}),
    ({"metadata": ["checked=true"]}, {"chair"}),
    ({"metadata": ["note=null"]}, {"chair"}),
    ({"metadata": ["ratio=0.5"]}, {"chair"}),
    ({"metadata": ["formula=a=b"]}, {"bird"}),
    ({"metadata": ["source=SCAN"]}, set()),
    ({"file_format": "stl"}, set()),
    ({"file_format": "off", "tag": "animal"}, {"Äpfel 100%", "bird"}),
    ({"metadata": ["source=scan"], "tag": "animal", "name": "i"}, {"bird"}),
]


@pytest.fixture(scope="module")
def stocked(shared: Running) -> Running:
    shared.clear()
    for number, (name, fields) in enumerate(SHAPES.items()):
        shared.store(small_file(number), name=name, **fields)
    return shared


def names(answer: dict[str, Any]) -> set[str]:
    return {result["shape"]["name"] for result in answer["results"]}


@pytest.mark.parametrize(("wanted", "expected"), FILTERS, ids=[str(wanted) for wanted, _ in FILTERS])
def test_lists_and_queries_have_the_shapes_that_pass(
    stocked: Running, wanted: dict[str, Any], expected: set[str]
) -> None:
    client = stocked.client
    page = client.get("/shapes", params=wanted).json()
    assert ({shape["name"] for shape in page["shapes"]}, page["total"]) == (expected, len(expected))
    in_form = query(client, small_file(9), top_k=100, **wanted).json()
    assert (names(in_form), in_form["compared"]) == (expected, len(expected))
    washer = {"shape_id": client.get("/shapes", params={"name": "washer"}).json()["shapes"][0]["id"]}
    assert names(client.post("/query", json={**washer, **wanted, "top_k": 100}).json()) == expected
    in_address = client.post("/query", params={**wanted, "top_k": 100}, json=washer).json()
    assert names(in_address) == expected


def test_a_hash_finds_the_shapes_of_a_file_that_is_not_uploaded(stocked: Running) -> None:
    client = stocked.client
    for number, name in enumerate(SHAPES):
        wanted = {"sha256": hashlib.sha256(small_file(number)).hexdigest()}
        assert [shape["name"] for shape in client.get("/shapes", params=wanted).json()["shapes"]] == [name]
        assert client.get("/shapes", params={**wanted, "name": "other"}).json()["total"] == 0
    assert client.get("/shapes", params={"sha256": "0" * 64}).json()["total"] == 0
    assert_problem(client.get("/shapes", params={"sha256": "0" * 63}), 422, "bad-request-fields")


def test_shapes_are_left_out_by_their_ids(stocked: Running) -> None:
    # An empty tag is no filter.
    every = query(stocked.client, small_file(9), top_k=100, tag="").json()["results"]
    ids = [result["shape"]["id"] for result in every]
    for excluded in (ids[:2], ",".join(ids[:2])):
        answer = query(stocked.client, small_file(9), top_k=100, exclude=excluded).json()
        assert [result["shape"]["id"] for result in answer["results"]] == ids[2:]
        assert answer["compared"] == 2
    as_json = {"shape_id": ids[0], "exclude": [ids[1], "no such id"], "top_k": 100}
    found = stocked.client.post("/query", json=as_json).json()["results"]
    assert {result["shape"]["id"] for result in found} == set(ids[2:])


def test_results_under_a_cc_are_not_given(stocked: Running) -> None:
    every = query(stocked.client, small_file(2), top_k=100).json()
    scores = [result["cc"] for result in every["results"]]
    assert scores == sorted(scores, reverse=True)
    for limit, count in ((scores[0], 1), ((scores[1] + scores[2]) / 2, 2), (-1, 4)):
        answer = query(stocked.client, small_file(2), top_k=100, min_cc=limit).json()
        assert answer["results"] == every["results"][:count]
        assert answer["compared"] == 4
        assert answer["matched"] == every["matched"]
    # Shapes that are left out make room for others, in every order.
    by_ssd = query(
        stocked.client, small_file(2), top_k=2, rank_by="ssd", min_cc=(scores[1] + scores[2]) / 2
    ).json()
    assert {result["cc"] for result in by_ssd["results"]} == set(scores[:2])


def test_a_bolt_of_another_size_is_another_bolt(service: Running) -> None:
    mesh = read_mesh(small_file(3), "off")
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for size in (6, 6.5, 8, 12):
        data = write_mesh(Mesh(size * mesh.vertices @ turn, mesh.faces), "off")
        service.store(data, f"m{size}.off")
    data = write_mesh(Mesh(6 * mesh.vertices, mesh.faces), "off")
    for scale, expected in (
        ("ignore", {"m6.off", "m6.5.off", "m8.off", "m12.off"}),
        ("respect", {"m6.off", "m6.5.off"}),
    ):
        answer = query(service.client, data, top_k=100, scale=scale).json()
        assert names(answer) == expected
        assert answer["compared"] == len(expected)
        assert all(result["cc"] > 0.999 for result in answer["results"])
    # The same of a stored shape, and on both sides of the limit.
    same_size = 1.0 + SIZE_TOLERANCE
    for factor, found in (
        (same_size - 0.001, True),
        (same_size + 0.001, False),
        (1 / same_size + 0.001, True),
    ):
        data = write_mesh(Mesh(12 * factor * mesh.vertices, mesh.faces), "off")
        assert ("m12.off" in names(query(service.client, data, scale="respect").json())) == found
    twelve = service.client.get("/shapes", params={"name": "m12"}).json()["shapes"][0]["id"]
    alone = service.client.post("/query", json={"shape_id": twelve, "scale": "respect"}).json()
    assert (alone["results"], alone["compared"], alone["matched"]) == ([], 0, False)
