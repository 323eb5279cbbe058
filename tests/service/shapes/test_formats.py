"""3MF and STEP through the whole service."""

import numpy as np
import pytest

from core.io import read_mesh, write_mesh
from tests.core.io.step_files import step_box
from tests.core.io.threemf_files import mesh, model, package, thing
from tests.service.support import Running, assert_problem, query, upload

SIZE = (25.4, 50.8, 76.2)
STORED = step_box(SIZE)
BOX = read_mesh(STORED, "step")
INCHES = package(model(thing(1, mesh(BOX.vertices / 25.4, BOX.faces)), head='unit="inch"'))


def test_they_are_stored_sent_back_and_written_in_other_formats(shared: Running) -> None:
    shape = shared.store(STORED, "bracket.STP")
    assert (shape["format"], shape["name"], shape["facts"]["faces"]) == ("step", "bracket.STP", 12)
    answer = shared.client.get(f"/shapes/{shape['id']}/file")
    assert answer.content == STORED
    assert answer.headers["content-type"] == "model/step"
    assert answer.headers["content-disposition"].endswith("''bracket.STP")
    written = shared.client.get(f"/shapes/{shape['id']}/file", params={"format": "off"}).content
    assert np.array_equal(read_mesh(written, "off").vertices, BOX.vertices)
    assert shared.client.get(f"/shapes/{shape['id']}/thumbnail.png").status_code == 200


def test_units_are_respected_across_formats(shared: Running) -> None:
    bolt = shared.store(INCHES, "bolt.3mf", tags=["inches"])
    assert bolt["format"] == "3mf"
    asked = {"tag": "inches", "scale": "respect"}
    found = query(shared.client, STORED, "bolt.step", **asked).json()["results"]
    assert [result["shape"]["id"] for result in found] == [bolt["id"]]
    assert found[0]["cc"] == pytest.approx(1, abs=0.01)
    small = write_mesh(type(BOX)(BOX.vertices / 25.4, BOX.faces), "off")
    assert query(shared.client, small, "bolt.off", **asked).json()["results"] == []


def test_without_the_extra_the_answer_names_it(shared: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.io.formats.find_spec", lambda name: None)
    answer = upload(shared.client, STORED, "other.step")
    assert_problem(answer, 415, "unknown-format")
    assert "isoshape[step]" in answer.json()["detail"]
