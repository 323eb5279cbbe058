"""Listing, reading, changing and deleting what is stored."""

import io
from datetime import datetime
from email.message import Message
from urllib.parse import unquote

import numpy as np
import pytest

from core.errors import MeshTooComplexError
from core.io import FORMATS, read_mesh, writable, write_mesh
from core.mesh.mesh import Mesh
from core.serialization import embedding_from_bytes
from service.client import Client
from service.collection import DEFAULT_COLLECTION
from service.shapes import file_repository
from service.shapes.file_endpoints import check_size
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, pipeline_in_use, small_file, upload


def listed(service: Running, sort: str, limit: int = 2) -> list[str]:
    """The names of all shapes, page by page."""
    seen: list[str] = []
    cursor: str | None = ""
    while cursor is not None:
        params = {"sort": sort, "limit": limit, **({"cursor": cursor} if cursor else {})}
        page = service.client.get("/shapes", params=params).json()
        assert page["total"] == 7
        seen += [shape["name"] for shape in page["shapes"]]
        cursor = page["next_cursor"]
        # A full page may be the last.
        assert (cursor is None) == (len(seen) == 7)
    return seen


@on_both
def test_an_id_that_no_database_holds_is_not_found(service: Running) -> None:
    client, zero = service.client, {"first": "\0", "second": "\0"}
    for answer in (
        client.get("/shapes/%00"),
        client.delete("/shapes/%00"),
        client.post("/query", json={"shape_id": "\0"}),
        client.post("/compare", json=zero),
    ):
        assert_problem(answer, 404, "shape-not-found")
    assert_problem(client.get("/jobs/%00"), 404, "job-not-found")


@on_both
def test_pages_have_an_order(service: Running) -> None:
    names = ["beta", "Alpha", "gamma", "alpha", "Beta 2", "Émile"]
    for i, name in enumerate(names):
        service.store(small_file(i), name=name)
    # One name twice: the older shape comes first.
    service.store(small_file(7), name="beta")
    assert listed(service, "oldest") == [*names, "beta"]
    assert listed(service, "newest") == ["beta", *reversed(names)]
    by_name = listed(service, "name")
    assert by_name[:5] == ["Alpha", "alpha", "beta", "beta", "Beta 2"]
    assert sorted(by_name) == sorted([*names, "beta"])
    for limit in (1, 3, 7):
        assert listed(service, "name", limit) == by_name


def test_a_cursor_of_another_order_is_refused(service: Running) -> None:
    for i in range(3):
        service.store(small_file(0), name=f"bird {i}")
    first = service.client.get("/shapes", params={"limit": 1, "sort": "name"}).json()
    for sort in ("oldest", "newest"):
        answer = service.client.get("/shapes", params={"cursor": first["next_cursor"], "sort": sort})
        assert assert_problem(answer, 422, "bad-request-fields")["errors"][0]["field"] == "cursor"
    assert service.client.get("/shapes", params={"sort": "size"}).status_code == 422


@on_both
def test_pages_stay_true_while_shapes_come_and_go(service: Running) -> None:
    ids = [service.store(small_file(0), name=f"bird {i}")["id"] for i in range(6)]
    first = service.client.get("/shapes", params={"limit": 3}).json()
    service.client.delete(f"/shapes/{ids[1]}")
    service.client.delete(f"/shapes/{ids[2]}")
    new = service.store(small_file(0), name="new")["id"]
    rest = service.client.get("/shapes", params={"limit": 100, "cursor": first["next_cursor"]}).json()
    assert [shape["id"] for shape in rest["shapes"]] == [*ids[3:], new]


@on_both
def test_changes_replace_what_is_given_and_leave_the_rest(service: Running) -> None:
    shape = service.store(small_file(0), name="old", tags="a,b", metadata='{"x": 1, "y": {"z": [1, 2]}}')
    address = f"/shapes/{shape['id']}"
    renamed = service.client.patch(address, json={"name": "new"}).json()
    assert renamed == {**shape, "name": "new", "updated_at": renamed["updated_at"]}
    assert datetime.fromisoformat(renamed["updated_at"]) > datetime.fromisoformat(shape["updated_at"])
    changed = service.client.patch(address, json={"tags": ["c", "b"], "metadata": {"y": 2}}).json()
    assert (changed["name"], changed["tags"], changed["metadata"]) == ("new", ["c", "b"], {"y": 2})
    assert service.client.get(address).json() == changed
    assert service.client.patch(address, json={}).json() == changed
    emptied = service.client.patch(address, json={"tags": [], "metadata": {}}).json()
    assert (emptied["tags"], emptied["metadata"]) == ([], {})
    for params, total in (
        ({"tag": "b"}, 0),
        ({"metadata": "y=2"}, 0),
        ({"name": "new"}, 1),
        ({"name": "old"}, 0),
    ):
        assert service.client.get("/shapes", params=params).json()["total"] == total


@on_both
def test_a_name_that_the_same_bytes_have_already_is_taken(service: Running) -> None:
    one = service.store(small_file(0), name="one")
    service.store(small_file(0), name="two")
    service.store(small_file(1), name="three")
    address = f"/shapes/{one['id']}"
    assert_problem(service.client.patch(address, json={"name": "two"}), 409, "name-taken")
    assert service.client.patch(address, json={"name": "three"}).status_code == 200
    assert service.client.patch(address, json={"name": "three"}).status_code == 200


@pytest.mark.parametrize(
    ("name", "saved_as"),
    [
        ("horse", "horse.off"),
        ("HORSE.OFF", "HORSE.OFF"),
        ('a"b; filename=evil.exe', 'a"b; filename=evil.exe.off'),
        ("Pferd äöü 马", "Pferd äöü 马.off"),
        ("per%20cent\\back", "per%20cent\\back.off"),
    ],
)
def test_a_file_is_saved_under_the_shapes_name_whatever_that_holds(
    service: Running, name: str, saved_as: str
) -> None:
    shape = service.store(small_file(0), name=name)
    answer = service.client.get(f"/shapes/{shape['id']}/file")
    assert answer.content == small_file(0)
    header = answer.headers["content-disposition"]
    assert header.isascii()
    kind, plain, starred = header.split("; ")
    assert kind == "attachment"
    assert unquote(starred.removeprefix("filename*=UTF-8''")) == saved_as
    assert not set(plain.removeprefix('filename="').removesuffix('"')) & set('";\\/%')
    message = Message()
    message["content-disposition"] = header
    assert message.get_params(header="content-disposition") is not None


@pytest.mark.parametrize(
    ("format", "media_type"), [("glb", "model/gltf-binary"), ("off", "application/octet-stream")]
)
def test_a_file_has_its_media_type_and_is_not_sent_twice(
    service: Running, format: str, media_type: str
) -> None:
    shape = upload(service.client, small_file(0, format), f"bird.{format}").json()
    address = f"/shapes/{shape['id']}/file"
    answer = service.client.get(address)
    assert answer.headers["content-type"] == media_type
    assert answer.headers["x-content-type-options"] == "nosniff"
    tag = answer.headers["etag"]
    assert tag == f'"{shape["sha256"]}"'
    for known in (tag, f"W/{tag}", f'"other", {tag}', "*"):
        again = service.client.get(address, headers={"if-none-match": known})
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
    assert service.client.get(address, headers={"if-none-match": '"other"'}).status_code == 200
    head = service.client.head(address)
    assert (head.status_code, head.content) == (200, b"")
    for header in ("content-length", "content-type", "content-disposition", "etag"):
        assert head.headers[header] == answer.headers[header]
    assert service.client.head(address, headers={"if-none-match": tag}).status_code == 304


def test_the_embedding_is_the_one_that_is_stored(service: Running) -> None:
    shape = service.store(small_file(0))
    with service.container.database.read() as session:
        found = file_repository.embedding_of(
            session, pipeline_in_use(service).fingerprint, DEFAULT_COLLECTION.number, shape["id"]
        )
    stored = embedding_from_bytes(found.record)
    address = f"/shapes/{shape['id']}/embedding"
    told = service.client.get(address).json()
    archive = service.client.get(address, params={"format": "npz"})
    assert archive.headers["content-type"] == "application/zip"
    arrays = np.load(io.BytesIO(archive.content))
    assert told["pipeline"] == stored.fingerprint
    for name in (
        "positions",
        "vertices",
        "graph_edges",
        "graph_lengths",
        "tree_edges",
        "regions",
        "signature",
    ):
        np.testing.assert_array_equal(np.array(told[name], dtype=arrays[name].dtype), getattr(stored, name))
        np.testing.assert_array_equal(arrays[name], getattr(stored, name))
    assert [spectrum["name"] for spectrum in told["spectra"]] == [s.name for s in stored.spectra]
    for spectrum, said in zip(stored.spectra, told["spectra"], strict=True):
        np.testing.assert_array_equal(np.float32(said["coordinates"]), spectrum.coordinates)
        np.testing.assert_array_equal(arrays[f"{spectrum.name}_coordinates"], spectrum.coordinates)
        np.testing.assert_array_equal(arrays[f"{spectrum.name}_eigenvalues"], spectrum.eigenvalues)
    again = service.client.get(address, params={"format": "npz"})
    assert again.content == archive.content
    answer = service.client.get(address, params={"format": "xml"})
    assert assert_problem(answer, 422, "bad-request-fields")["errors"][0]["field"] == "format"


@pytest.mark.parametrize("format", writable())
def test_a_mesh_is_written_in_another_format(service: Running, format: str) -> None:
    shape = service.store(small_file(0), name="bird.off")
    answer = service.client.get(f"/shapes/{shape['id']}/file", params={"format": format})
    assert answer.status_code == 200
    assert answer.headers["content-type"] == FORMATS[format].media_type
    assert answer.headers["content-disposition"].endswith(
        f"''bird.off{'' if format == 'off' else f'.{format}'}"
    )
    written, mesh = read_mesh(answer.content, format), read_mesh(small_file(0), "off")
    exact = format in {"obj", "off", "3mf"}
    np.testing.assert_allclose(
        written.vertices[written.faces], mesh.vertices[mesh.faces], rtol=0, atol=0 if exact else 1e-6
    )
    tag = answer.headers["etag"]
    assert (tag == f'"{shape["sha256"]}"') == (format == "off")
    address, wanted = f"/shapes/{shape['id']}/file", {"format": format}
    again = service.client.get(address, params=wanted, headers={"if-none-match": tag})
    assert (again.status_code, again.content) == (304, b"")
    head = service.client.head(address, params=wanted)
    assert (head.headers["content-length"], head.content) == (str(len(answer.content)), b"")
    with Client(str(service.client.base_url)) as client:
        assert client.file(shape["id"], format=format) == answer.content


def test_no_larger_file_is_written_than_may_be_uploaded() -> None:
    mesh = read_mesh(small_file(0), "off")
    # As many digits as there are.
    mesh = Mesh(-np.pi * 1e-300 * (1.0 + mesh.vertices**2), mesh.faces)
    for format in writable():
        size = len(write_mesh(mesh, format)) - 1024
        with pytest.raises(MeshTooComplexError, match=format.upper()):
            check_size(mesh, format, size)
        # A 3MF is packed after it is counted.
        check_size(mesh, format, (6 if format == "3mf" else 3) * size)


def test_an_unknown_format_is_not_written(service: Running) -> None:
    shape = service.store(small_file(0), name="bird.off")
    for wrong in ("step", "", "OFF"):
        answer = service.client.get(f"/shapes/{shape['id']}/file", params={"format": wrong})
        assert_problem(answer, 422, "bad-request-fields")
