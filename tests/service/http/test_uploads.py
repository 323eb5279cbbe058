"""Storing files: what comes back, what is kept once, and what is refused."""

import dataclasses
import errno
import hashlib
import io
import os
import tempfile
from datetime import UTC, datetime, timedelta
from tempfile import SpooledTemporaryFile
from typing import IO, Any

import numpy as np
import pytest
import trimesh

from core.evaluation.perturbation import cut_part
from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from service.compute.tasks import Embedded
from service.http.request_bodies import FORM_FIELDS
from service.storage.tables import BlobRow, EmbeddingRow, ShapeRow
from tests.core.io.files import PLAIN
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, pipeline_in_use, query, small_file, upload

TABLES = (ShapeRow, BlobRow, EmbeddingRow)


def test_a_stored_shape_is_what_was_sent(service: Running) -> None:
    data = small_file(0)
    answer = upload(
        service.client, data, "bird.off", name="A bird", tags=["animal", "bird"], metadata='{"year": 2024}'
    )
    assert answer.status_code == 201
    shape = answer.json()
    assert answer.headers["location"] == f"/shapes/{shape['id']}"
    mesh = read_mesh(data, "off")
    assert shape["name"] == "A bird"
    assert shape["tags"] == ["animal", "bird"]
    assert shape["metadata"] == {"year": 2024}
    assert shape["format"] == "off"
    assert shape["bytes"] == len(data)
    assert shape["sha256"] == hashlib.sha256(data).hexdigest()
    assert (shape["facts"]["vertices"], shape["facts"]["faces"]) == (len(mesh.vertices), len(mesh.faces))
    assert shape["embedded"] is True
    created = datetime.fromisoformat(shape["created_at"])
    assert created.tzinfo == UTC
    assert abs(datetime.now(UTC) - created) < timedelta(minutes=1)
    assert service.client.get(answer.headers["location"]).json() | {"created": True, "changed": []} == shape


@pytest.mark.parametrize("format", sorted(PLAIN))
def test_every_format_is_stored_and_given_back_byte_for_byte(service: Running, format: str) -> None:
    data = small_file(0, format)
    answer = upload(service.client, data, f"snake.{format.upper()}")
    assert answer.status_code == 201, answer.text
    assert answer.json()["format"] == format
    assert answer.json()["facts"]["faces"] == len(read_mesh(data, format).faces)
    assert service.client.get(answer.headers["location"] + "/file").content == data


def test_the_same_bytes_under_the_same_name_are_one_shape(service: Running) -> None:
    first = upload(service.client, small_file(0), "bird.off", tags="old")
    second = upload(service.client, small_file(0), "bird.off", tags="old")
    assert (first.status_code, second.status_code) == (201, 200)
    assert second.json() == first.json() | {"created": False}
    assert second.headers["location"] == first.headers["location"]
    assert service.client.get("/shapes").json()["total"] == 1


@on_both
def test_the_same_bytes_under_another_name_share_blob_and_embedding(service: Running) -> None:
    one = service.store(small_file(0), name="one")
    two = service.store(small_file(0), name="two")
    assert one["id"] != two["id"]
    assert one["facts"] == two["facts"]
    assert [service.rows(table) for table in TABLES] == [2, 1, 1]
    assert service.client.delete(f"/shapes/{one['id']}").status_code == 204
    assert [service.rows(table) for table in TABLES] == [1, 1, 1]
    assert service.client.get(f"/shapes/{two['id']}/file").content == small_file(0)
    assert service.client.get(f"/shapes/{two['id']}/embedding").status_code == 200
    assert service.client.delete(f"/shapes/{two['id']}").status_code == 204
    assert [service.rows(table) for table in TABLES] == [0, 0, 0]


@pytest.mark.parametrize(
    ("filename", "name"),
    [
        ("horse.off", "horse.off"),
        ("/home/me/horse.off", "horse.off"),
        (r"C:\models\horse.off", "horse.off"),
        ("../../etc/passwd.off", "passwd.off"),
        ("  Pferd äöü 马.off", "Pferd äöü 马.off"),
    ],
)
def test_the_name_is_by_default_the_files_own_without_folders(
    service: Running, filename: str, name: str
) -> None:
    assert upload(service.client, small_file(0), filename).json()["name"] == name


@pytest.mark.parametrize("tags", [["a", "b", "c"], ["a,b,c"], ["a, b", "c", "a"], ["a,,b , ", "", "c"]])
def test_tags_are_repeated_or_separated_by_commas(service: Running, tags: list[str]) -> None:
    assert upload(service.client, small_file(0), "bird.off", tags=tags).json()["tags"] == ["a", "b", "c"]


def test_a_form_without_a_file_is_refused(service: Running) -> None:
    answer = service.client.post("/shapes", files={"name": (None, "horse")})
    assert assert_problem(answer, 422, "bad-request-fields")["errors"][0]["field"] == "file"
    as_text = service.client.post("/shapes", files={"file": (None, "OFF")})
    assert assert_problem(as_text, 422, "bad-request-fields")["errors"][0]["field"] == "file"
    elsewhere = service.client.post("/shapes", files={"mesh": ("bird.off", small_file(0))})
    assert assert_problem(elsewhere, 422, "bad-request-fields")["errors"][0]["field"] == "mesh"


def test_a_body_that_is_no_form_is_refused(service: Running) -> None:
    assert_problem(service.client.post("/shapes", json={"name": "x"}), 415, "unsupported-media-type")
    assert_problem(service.client.post("/shapes"), 415, "unsupported-media-type")
    broken = {"content-type": "multipart/form-data; boundary=b"}
    assert_problem(service.client.post("/shapes", content=b"nonsense", headers=broken), 400, "bad-request")
    headers = {"content-type": "multipart/form-data"}
    assert_problem(service.client.post("/shapes", content=b"--", headers=headers), 400, "bad-request")


def test_a_form_takes_one_file_and_so_many_fields(service: Running) -> None:
    data = small_file(0)
    two = [("file", ("a.off", data)), ("file", ("b.off", data))]
    assert_problem(service.client.post("/shapes", files=two), 400, "bad-request")
    many = upload(service.client, data, "bird.off", tags=[f"t{i}" for i in range(FORM_FIELDS + 1)])
    assert "fields" in assert_problem(many, 400, "bad-request")["detail"]
    long = upload(service.client, data, "bird.off", metadata="x" * 70_000)
    assert_problem(long, 400, "bad-request")


@pytest.mark.parametrize("send", [upload, query])
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_no_room_for_the_upload_is_said(
    service: Running, monkeypatch: pytest.MonkeyPatch, send: Any, number: int
) -> None:
    def full(*_arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    data = small_file(0) + b"\n" * (2 * 1024 * 1024)
    with monkeypatch.context() as patch:
        patch.setattr(SpooledTemporaryFile, "rollover", full)
        assert_problem(send(service.client, data, "large.off"), 507, "storage-full")
        patch.setattr(SpooledTemporaryFile, "rollover", _fail)
        assert_problem(send(service.client, data, "large.off"), 503, "storage-unavailable")
    assert send(service.client, data, "large.off").status_code in {200, 201}


@pytest.mark.parametrize("size", [2 * 1024 * 1024, 1024 * 1024 + 1])
def test_a_full_temporary_folder_is_said(
    service: Running, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    def full(*_arguments: object, **_options: object) -> IO[bytes]:
        return open("/dev/full", "w+b")

    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "TemporaryFile", full)
        assert_problem(upload(service.client, b"x" * size, "large.off"), 507, "storage-full")


def _fail(*_arguments: object) -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def test_a_mesh_that_is_simplified_is_stored_and_found(service: Running) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5)
    points = ball.vertices * (1 + 0.2 * ball.vertices[:, :1] ** 2 + 0.1 * ball.vertices[:, 1:2])
    assert len(points) > pipeline_in_use(service).parameters.mesh.decimate_above > 0
    for name, coordinates in (("ball", ball.vertices), ("pear", points)):
        data = write_mesh(Mesh(coordinates, ball.faces), "stl")
        answer = upload(service.client, data, f"{name}.stl")
        assert answer.status_code == 201, answer.text
        assert answer.json()["facts"]["faces"] == len(ball.faces)
        found = query(service.client, data, f"{name}.stl").json()["results"]
        assert found[0]["shape"]["id"] == answer.json()["id"]


@on_both
def test_a_signature_of_another_length_is_not_stored(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = service.store(small_file(0))
    work = service.container.queue
    embed = work.embed

    async def shorter(data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        embedded = await embed(data, format, pipeline)
        return dataclasses.replace(embedded, signature=embedded.signature[:-1])

    with monkeypatch.context() as patch:
        patch.setattr(work, "embed", shorter)
        answer = upload(service.client, small_file(1), "short.off")
    assert "signature" in assert_problem(answer, 500, "internal-error")["detail"]
    assert [service.rows(table) for table in TABLES] == [1, 1, 1]
    results = query(service.client, small_file(0)).json()["results"]
    assert [result["shape"]["id"] for result in results] == [kept["id"]]


def test_an_incomplete_shape_is_stored_and_searched_with_a_warning(service: Running) -> None:
    whole = read_mesh(small_file(1), "off")
    part = write_mesh(cut_part(whole, 0.4, 0), "off")
    assert service.store(small_file(1), "whole.off")["warnings"] == []
    stored = service.store(part, "part.off")
    (warning,) = stored["warnings"]
    assert "looks incomplete" in warning
    assert f"{100 * stored['facts']['boundary_ratio']:.0f} %" in warning
    assert query(service.client, part).json()["warnings"] == [warning]
    assert query(service.client, small_file(1)).json()["warnings"] == []


def test_what_a_reader_left_out_is_told_by_uploads_and_queries(service: Running) -> None:
    data = small_file(1, "stl") + b"more"
    stored = service.store(data, "longer.stl")
    (warning,) = stored["warnings"]
    assert "the rest is left out" in warning
    assert query(service.client, data, filename="longer.stl").json()["warnings"] == [warning]
    assert service.client.get(f"/shapes/{stored['id']}").json()["warnings"] == [warning]


def test_lengths_are_in_millimetres_where_the_format_states_a_unit(service: Running) -> None:
    mesh = read_mesh(small_file(1), "off")
    shapes = {
        format: service.store(write_mesh(mesh, format), f"ball.{format}") for format in ("off", "glb", "3mf")
    }
    assert {format: shape["unit"] for format, shape in shapes.items()} == {
        "off": "",
        "glb": "mm",
        "3mf": "mm",
    }
    for shape in shapes.values():
        assert shape["facts"]["area"] == pytest.approx(shapes["off"]["facts"]["area"], rel=1e-4)
    # The file of a GLB is in metres.
    written = service.client.get(f"/shapes/{shapes['3mf']['id']}/file", params={"format": "glb"}).content
    assert np.ptp(trimesh.load(io.BytesIO(written), file_type="glb", force="mesh").vertices) < 0.01
    assert read_mesh(written, "glb").vertices == pytest.approx(mesh.vertices, abs=1e-6)
