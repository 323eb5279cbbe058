"""Files of every format: those that cannot be used are refused by cause; 3MF and STEP through the service."""

import base64
import io
import json
import zipfile

import numpy as np
import pytest

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import glb, gltf
from tests.core.io.step_files import step_box
from tests.core.io.threemf_files import mesh, model, package, thing
from tests.service.support import Running, assert_problem, query, small_file, upload

TRIANGLE = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"

REFUSED = {
    "empty.off": (b"", 422, "empty-file"),
    "truncated.glb": (small_file(0, "glb")[:-7], 422, "malformed-mesh"),
    "points.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", 422, "no-triangles"),
    "nan.off": (TRIANGLE.replace(b"1 0 0\n0 1", b"nan 0 0\n0 1"), 422, "non-finite-coordinates"),
    "point.off": (b"OFF\n3 1 0\n1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n", 422, "degenerate-mesh"),
    "elsewhere.glb": (
        glb(buffers=[{"byteLength": 36, "uri": "file:///etc/passwd"}]),
        422,
        "external-reference",
    ),
    "horse.step": (TRIANGLE, 422, "malformed-mesh"),
    "horse.3mf": (TRIANGLE, 422, "malformed-mesh"),
    "horse.dae": (TRIANGLE, 415, "unknown-format"),
    "horse": (TRIANGLE, 415, "unknown-format"),
    ".off/horse": (TRIANGLE, 415, "unknown-format"),
    "horse.off.zip": (TRIANGLE, 422, "malformed-mesh"),
}
"""One file of each kind of problem; `tests/core/io` has all that is wrong with files."""


@pytest.mark.parametrize("filename", REFUSED)
def test_a_file_that_cannot_be_used_is_refused_by_its_cause(shared: Running, filename: str) -> None:
    data, status, kind = REFUSED[filename]
    stored = shared.client.get("/shapes").json()["total"]
    assert_problem(upload(shared.client, data, filename), status, kind)
    assert_problem(query(shared.client, data, filename), status, kind)
    assert shared.client.get("/shapes").json()["total"] == stored


@pytest.mark.parametrize(
    "mesh",
    [
        Mesh(np.eye(3), np.array([[0, 1, 2]])),
        Mesh(np.eye(3), np.array([[0, 1, 2], [2, 1, 0]])),
        Mesh(1e-30 * np.eye(3), np.array([[0, 1, 2]])),
        Mesh(1e30 * np.eye(3), np.array([[0, 1, 2]])),
        Mesh(np.vstack([np.eye(3), np.eye(3) + 100]), np.array([[0, 1, 2], [3, 4, 5]])),
        Mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 1e-12, 0], [1, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])),
    ],
)
def test_a_strange_mesh_is_stored_and_searched_or_refused(service: Running, mesh: Mesh) -> None:
    answer = upload(service.client, write_mesh(mesh, "off"), "strange.off")
    if answer.status_code == 422:
        assert answer.json()["type"] == "urn:isoshape:problem:degenerate-mesh"
        return
    assert answer.status_code == 201, answer.text
    service.store(small_file(0), name="ball")
    results = query(service.client, write_mesh(mesh, "off")).json()["results"]
    assert {result["shape"]["name"] for result in results} == {"strange.off", "ball"}
    assert all(
        np.isfinite([result[key] for key in ("cc", "ssd", "sim", "combined")]).all() for result in results
    )
    found = query(service.client, small_file(0)).json()["results"][0]
    assert found["shape"]["name"] == "ball"


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


def zipped_gltf() -> bytes:
    """A ZIP of a JSON and its buffer."""
    tree, binary = gltf()
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("a.gltf", json.dumps({**tree, "buffers": [{**tree["buffers"][0], "uri": "a.bin"}]}))
        archive.writestr("a.bin", binary)
    return file.getvalue()


def embedded_gltf() -> bytes:
    """A JSON that holds its buffer."""
    tree, binary = gltf()
    uri = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    return json.dumps({**tree, "buffers": [{**tree["buffers"][0], "uri": uri}]}).encode()


@pytest.mark.parametrize(
    ("data", "name", "saved_as", "media_type"),
    [
        (embedded_gltf(), "cube.gltf", "cube.gltf", "model/gltf+json"),
        (embedded_gltf(), "cube.glb", "cube.glb.gltf", "model/gltf+json"),
        (zipped_gltf(), "cube.zip", "cube.zip", "application/zip"),
        (zipped_gltf(), "cube.gltf", "cube.gltf.zip", "application/zip"),
        (glb(), "cube.gltf", "cube.gltf.glb", "model/gltf-binary"),
        (glb(), "cube.glb", "cube.glb", "model/gltf-binary"),
    ],
)
def test_every_form_of_gltf_is_sent_back_as_what_it_is_and_glb_is_binary(
    shared: Running, data: bytes, name: str, saved_as: str, media_type: str
) -> None:
    shape = shared.store(data, name)
    assert shape["format"] == "glb"
    address = f"/shapes/{shape['id']}/file"
    for wanted, saved, kind in (
        ({}, saved_as, media_type),
        ({"format": "glb"}, name if name.endswith(".glb") else f"{name}.glb", "model/gltf-binary"),
    ):
        answer = shared.client.get(address, params=wanted)
        assert (
            answer.headers["content-type"],
            answer.headers["content-disposition"].rpartition("''")[2],
        ) == (kind, saved)
        assert answer.content[:4] == b"glTF" if wanted else answer.content == data
        assert np.array_equal(read_mesh(answer.content, "glb").vertices, read_mesh(data, "glb").vertices)
        assert (answer.headers["etag"] == f'"{shape["sha256"]}"') == (answer.content == data)
        head = shared.client.head(address, params=wanted)
        for header in ("content-length", "content-type", "content-disposition", "etag"):
            assert head.headers[header] == answer.headers[header]
        tag = {"if-none-match": answer.headers["etag"]}
        assert shared.client.get(address, params=wanted, headers=tag).status_code == 304


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
