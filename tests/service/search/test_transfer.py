"""Landmarks and transfers over HTTP: of ids and of files, and what is refused."""

import json
from typing import Any

import numpy as np
import pytest

from core.io import read_mesh, write_mesh
from service.search.transfer_schemas import LANDMARKS
from tests.core.shapes import scaled, turned
from tests.service.support import Running, assert_problem, small_file

ONE = read_mesh(small_file(1), "off")
OTHER = scaled(turned(ONE, 3), 25.4)
CHOSEN = [3, 50, 90]
POINTS, PARTNERS = (mesh.vertices[CHOSEN].tolist() for mesh in (ONE, OTHER))
SIZE = float(np.ptp(OTHER.vertices))

pytestmark = pytest.mark.usefixtures("few_functions")


@pytest.fixture(scope="module")
def ids(shared: Running) -> tuple[str, str]:
    """A ball, and the same turned and 25.4 times as large; nothing here changes them."""
    shared.clear()
    other = write_mesh(OTHER, "off")
    return shared.store(small_file(1), "one.off")["id"], shared.store(other, "turned.off")["id"]


def body(ids: tuple[str, str], **fields: Any) -> dict[str, Any]:
    return {"first": ids[0], "second": ids[1], **fields}


def test_points_curves_and_values_of_a_copy(shared: Running, ids: tuple[str, str]) -> None:
    values = ONE.vertices[:, 0].tolist()
    wanted = {"points": POINTS, "curves": [POINTS], "values": values}
    answer = shared.client.post("/compare", json=body(ids, transfer=wanted))
    assert answer.status_code == 200, answer.text
    assert answer.json()["vertices"] is None
    found = answer.json()["transferred"]
    np.testing.assert_allclose([each["position"] for each in found["points"]], PARTNERS, atol=1e-4 * SIZE)
    assert min(each["confidence"] for each in found["points"]) > 0.95
    (curve,) = found["curves"]
    np.testing.assert_allclose(curve["second"][0], PARTNERS[0], atol=1e-4 * SIZE)
    assert curve["second_length"] == pytest.approx(25.4 * curve["first_length"], rel=1e-3)
    assert found["values"] == values
    straight = np.linalg.norm(np.array(POINTS)[:, None] - POINTS, axis=2)
    np.testing.assert_allclose(found["first_distances"]["straight"], straight, atol=1e-9)
    np.testing.assert_allclose(found["second_distances"]["straight"], 25.4 * straight, rtol=1e-3)
    for side in ("first_distances", "second_distances"):
        assert (np.array(found[side]["along"]) >= found[side]["straight"]).all()
    assert found["landmark_gaps"] == []


def test_a_form_takes_them_as_text(shared: Running, ids: tuple[str, str]) -> None:
    landmarks = [{"first": a, "second": b} for a, b in zip(POINTS, PARTNERS, strict=True)]
    data = {
        "first": ids[0],
        "landmarks": json.dumps(landmarks),
        "transfer": json.dumps({"points": POINTS}),
        "dense": "true",
    }
    files = {"second": ("x.off", write_mesh(OTHER, "off"))}
    answer = shared.client.post("/compare", data=data, files=files)
    assert answer.status_code == 200, answer.text
    found = answer.json()["transferred"]
    np.testing.assert_allclose([each["position"] for each in found["points"]], PARTNERS, atol=1e-4 * SIZE)
    assert max(found["landmark_gaps"]) < 1e-4 * SIZE
    assert answer.json()["vertices"] == list(range(len(ONE.vertices)))


PAIR = {"first": POINTS[0], "second": PARTNERS[0]}
FAR = {"first": POINTS[0], "second": [1e9, 0.0, 0.0]}
REFUSED: list[tuple[dict[str, Any], dict[str, Any], str, str]] = [
    ({}, {"landmarks": [PAIR] * (LANDMARKS + 1)}, "landmarks", "at most 64"),
    ({}, {"landmarks": []}, "landmarks", "at least 1"),
    ({}, {"landmarks": [{"first": [0.0, 1.0], "second": PARTNERS[0]}]}, "landmarks.0.first", "at least 3"),
    ({}, {"landmarks": [PAIR, FAR]}, "landmarks", "landmark 1 of the second shape is 1e+09 from the surface"),
    ({}, {"transfer": {"points": [*POINTS, [9.0, 9.0, 9.0]]}}, "transfer", "point 3 of the first shape is"),
    ({}, {"transfer": {"curves": [POINTS[:1]]}}, "transfer.curves.0", "at least 2"),
    ({}, {"transfer": {"curves": [[*POINTS, [9.0, 9.0, 9.0]]]}}, "transfer", "curve 0, point 3"),
    ({}, {"transfer": {"values": [1.0]}}, "transfer.values", "1 values for the 122 vertices"),
    ({}, {"transfer": {"ponits": POINTS}}, "transfer.ponits", ""),
    ({"format": "npz", "dense": "true"}, {"transfer": {"points": POINTS}}, "transfer", "format=json"),
    ({"format": "glb"}, {"landmarks": [PAIR]}, "landmarks", "dense=true"),
]


@pytest.mark.parametrize(("params", "fields", "field", "told"), REFUSED)
def test_what_cannot_be_transferred(
    shared: Running,
    ids: tuple[str, str],
    params: dict[str, str],
    fields: dict[str, Any],
    field: str,
    told: str,
) -> None:
    answer = shared.client.post("/compare", params=params, json=body(ids, **fields))
    problem = assert_problem(answer, 422, "bad-request-fields")
    assert [fault["field"] for fault in problem["errors"]] == [field]
    assert told in problem["errors"][0]["message"]
