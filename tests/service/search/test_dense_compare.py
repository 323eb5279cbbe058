"""Dense correspondences over HTTP: of ids, of files and of both; as JSON, as an archive and as a GLB."""

import io
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from core.embedding import DenseCorrespondence
from core.errors import CannotBeEmbeddedError
from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.compute import tasks
from service.rendering import colours as dense_colours
from tests.core.dense.solids import chair
from tests.core.shapes import scaled, turned
from tests.gallery import make_body
from tests.service.previews.test_previews import read_glb
from tests.service.support import Running, assert_problem, small_file
from tests.studies.copies import moved
from tests.studies.machine_parts import Drawing, part

OTHER = write_mesh(scaled(turned(read_mesh(small_file(1), "off"), 3), 25.4), "off")
COUNT = 122

pytestmark = pytest.mark.usefixtures("few_functions")


@pytest.fixture(scope="module")
def ids(shared: Running) -> tuple[str, str]:
    """A ball, and the same turned and 25.4 times as large; nothing here changes them."""
    shared.clear()
    return shared.store(small_file(1), "one.off")["id"], shared.store(OTHER, "turned.off")["id"]


def dense(running: Running, first: Any, second: Any, **params: Any) -> httpx.Response:
    """POST /compare with dense: a form if one of the two is a file, given as (name, bytes)."""
    given = {"first": first, "second": second}
    options = {"dense": "true", **params}
    files = {name: value for name, value in given.items() if isinstance(value, tuple)}
    if not files:
        return running.client.post("/compare", params=options, json=given)
    data = {name: value for name, value in given.items() if name not in files}
    return running.client.post("/compare", params=options, data=data, files=files)


@pytest.fixture(scope="module")
def answer(shared: Running, ids: tuple[str, str]) -> dict[str, Any]:
    found = dense(shared, *ids)
    assert found.status_code == 200, found.text
    return found.json()


def test_two_ids_have_a_vertex_for_each_vertex(
    shared: Running, ids: tuple[str, str], answer: dict[str, Any]
) -> None:
    assert answer["vertices"] == list(range(COUNT))
    assert len(answer["confidence"]) == COUNT
    assert 0.9 < min(answer["confidence"]) <= max(answer["confidence"]) <= 1.0
    assert answer["length_ratio"] == pytest.approx(25.4, rel=1e-3)
    assert answer["simplified"] is False
    for side in ("first_difference", "second_difference"):
        assert all(answer[side]["partnered"])
        assert max(answer[side]["displacement"]) < 1e-2
        np.testing.assert_allclose(answer[side]["stretch"], 1.0, atol=0.01)
    assert "dense" in answer["milliseconds"]
    sparse = shared.client.post("/compare", json={"first": ids[0], "second": ids[1]}).json()
    only_dense = {name for name in answer if sparse[name] is None and answer[name] is not None}
    assert only_dense == {
        "vertices",
        "confidence",
        "maps",
        "ambiguous",
        "mirrored",
        "length_ratio",
        "simplified",
        "first_difference",
        "second_difference",
    }
    same = set(answer) - only_dense - {"milliseconds"}
    assert {name: answer[name] for name in same} == {name: sparse[name] for name in same}


def assert_same(found: dict[str, Any], answer: dict[str, Any]) -> None:
    for name in ("vertices", "confidence", "cc", "likeness", "first_difference", "correspondence"):
        assert found[name] == answer[name], name


@pytest.mark.usefixtures("ids")
def test_files_give_the_same_as_ids(shared: Running, answer: dict[str, Any]) -> None:
    before = shared.client.get("/shapes").json()["total"]
    found = dense(shared, ("one.off", small_file(1)), ("turned.off", OTHER))
    assert found.status_code == 200, found.text
    assert_same(found.json(), answer)
    assert shared.client.get("/shapes").json()["total"] == before


def test_the_option_is_taken_in_the_body_too(
    shared: Running, ids: tuple[str, str], answer: dict[str, Any]
) -> None:
    body = {"first": ids[0], "second": ids[1], "dense": True}
    assert shared.client.post("/compare", json=body).json()["vertices"]
    off = {**body, "dense": False}
    assert shared.client.post("/compare?dense=true", json=off).json()["vertices"] is None
    for option in ({}, {"dense": "true"}):
        data, files = {"first": ids[0], **option}, {"second": ("x.off", OTHER)}
        found = shared.client.post("/compare", data=data, files=files)
        assert found.status_code == 200, found.text
        assert found.json()["cc"] == answer["cc"]
        if option:
            assert_same(found.json(), answer)
        else:
            assert found.json()["vertices"] is None


def test_an_archive_has_the_arrays(shared: Running, ids: tuple[str, str], answer: dict[str, Any]) -> None:
    found = dense(shared, *ids, format="npz")
    assert found.status_code == 200
    assert found.headers["content-type"] == "application/zip"
    with np.load(io.BytesIO(found.content)) as arrays:
        assert set(arrays) == {"vertices", "confidence", "stretch", "partnered", "displacement", "maps"}
        assert arrays["vertices"].dtype == np.int32
        assert arrays["vertices"].tolist() == answer["vertices"]
        np.testing.assert_allclose(arrays["confidence"], answer["confidence"], atol=1e-4)


def test_both_meshes_are_painted_alike(shared: Running, ids: tuple[str, str]) -> None:
    found = dense(shared, *ids, format="glb")
    assert found.headers["content-type"] == "model/gltf-binary"
    tree, _, (one, two) = read_glb(found.content)
    assert [node["name"] for node in tree["nodes"]] == ["one.off", "turned.off"]
    np.testing.assert_array_equal(one, two)
    assert np.ptp(one[:, :3], axis=0).min() > 150


def in_frame_of_first(
    found: httpx.Response,
) -> tuple[list[dict[str, Any]], list[np.ndarray], list[np.ndarray]]:
    """The extras, the vertices and the colours of both nodes."""
    assert found.status_code == 200, found.text
    tree, positions, colours = read_glb(found.content)
    extras = [node["extras"] for node in tree["nodes"]]
    points = [each["half"] * at + each["middle"] for each, at in zip(extras, positions, strict=True)]
    return extras, points, [each[:, :3].astype(int) for each in colours]


def test_a_missing_leg_is_painted_by_its_distance(shared: Running) -> None:
    whole = moved(chair(4), 3, scale=25.4)
    files = [("three.off", write_mesh(chair(3), "off")), ("four.off", write_mesh(whole, "off"))]
    found = dense(shared, *files, format="glb", paint="difference")
    extras, points, colours = in_frame_of_first(found)
    assert [each["quantity"] for each in extras] == ["distance", "distance"]
    assert not any(each["registered"] for each in extras)
    assert [each["size"] for each in extras] == pytest.approx([25.4, 25.4], rel=1e-3)
    # The middle of the socket is 0.1 from its rim, and the far edge of the foot 0.9 from the next leg.
    assert [each["largest"] for each in extras] == pytest.approx([0.1, 0.9], rel=0.01)
    assert [each["maximum"] for each in extras] == pytest.approx([0.9, 0.9], rel=0.01)
    for at in points:
        np.testing.assert_allclose(at.min(axis=0), 0.0, atol=1e-3)
        np.testing.assert_allclose(at.max(axis=0), [1.2, 1.1, 2.4], atol=1e-3)
    grey, brown = np.rint(255 * dense_colours.SCALE[[0, -1]])
    four = points[1]
    leg = (four[:, 0] > 0.99) & (four[:, 1] > 0.89) & (four[:, 2] < 0.999)
    foot = leg & (four[:, 0] > 1.101) & (four[:, 1] > 1.099) & (four[:, 2] < 0.01)
    assert foot.any()
    assert np.abs(colours[1][foot] - brown).max() <= 2
    assert (colours[1][~leg & (four[:, 2] > 1.001)] == grey).all()
    assert (colours[1][leg & (four[:, 2] < 0.9)] != grey).any(axis=1).all()
    # On the chair of three legs the socket alone differs.
    socket = points[0][(colours[0] != grey).any(axis=1)]
    np.testing.assert_allclose(socket, np.broadcast_to([1.1, 1.0, 1.0], socket.shape), atol=0.101)


def test_a_copy_has_no_difference_and_lies_on_the_first(shared: Running, ids: tuple[str, str]) -> None:
    found = dense(shared, *ids, format="glb", paint="difference")
    extras, points, colours = in_frame_of_first(found)
    ball = read_mesh(small_file(1), "off").vertices
    for each, at, painted in zip(extras, points, colours, strict=True):
        assert each["registered"]
        assert (each["largest"], each["maximum"]) == (0.0, 0.0)
        assert (painted == np.rint(255 * dense_colours.SCALE[0])).all()
        gaps = np.linalg.norm(ball[:, None] - at[None], axis=2).min(axis=1)
        assert gaps.max() < 1e-4 * np.ptp(ball)


def test_a_hole_in_a_large_triangle_is_painted(shared: Running) -> None:
    plain, drilled = (part("plate", Drawing(3, 0.02, change=change)) for change in (None, "hole"))
    radius = Drawing(3, 0.02).draw(3, 6, 3)
    files = [("plain.stl", write_mesh(plain, "stl")), ("drilled.stl", write_mesh(moved(drilled, 4), "stl"))]
    extras, points, colours = in_frame_of_first(dense(shared, *files, format="glb", paint="difference"))
    assert all(each["registered"] for each in extras)
    assert extras[0]["largest"] == pytest.approx(radius, rel=0.02)
    darkest = points[0][colours[0].sum(axis=1).argmin()]
    changed = points[0][(colours[0] != np.rint(255 * dense_colours.SCALE[0])).any(axis=1)]
    assert np.linalg.norm(changed[:, :2] - darkest[:2], axis=1).max() == pytest.approx(radius, rel=0.05)


def test_a_pose_is_painted_by_its_stretch(shared: Running) -> None:
    body = make_body("hand")
    files = [(f"{pose}.off", write_mesh(body.posed(pose), "off")) for pose in (0, 1)]
    tree, _, colours = read_glb(dense(shared, *files, format="glb", paint="difference").content)
    for node, painted in zip(tree["nodes"], colours, strict=True):
        assert node["extras"]["quantity"] == "stretch"
        assert node["extras"]["without_partner"] < 0.1
        assert len(painted) == len(body.posed(0).vertices)


def test_a_picture_shows_both_side_by_side(shared: Running, ids: tuple[str, str]) -> None:
    found = dense(shared, *ids, format="png", paint="difference")
    assert found.headers["content-type"] == "image/png"
    pixels = np.asarray(Image.open(io.BytesIO(found.content)).convert("RGBA")).astype(int)
    assert pixels.shape == (512, 1024, 4)
    for half in (pixels[:, :512], pixels[:, 512:]):
        seen = half[half[..., 3] == 255]
        assert len(seen) > 20_000
        # Nothing has moved: grey, in light and in shade.
        assert (np.ptp(seen[:, :3], axis=1) < 20).mean() > 0.99


def test_bodies_that_do_not_fit_are_refused(shared: Running, ids: tuple[str, str]) -> None:
    post = shared.client.post
    mesh = ("x.off", OTHER)
    assert_problem(post("/compare", files={"first": mesh}), 422, "bad-request-fields")
    assert_problem(post("/compare", files={"first": mesh, "file": mesh}), 422, "bad-request-fields")
    assert_problem(post("/compare?dense=true", content=b"x"), 415, "unsupported-media-type")
    files = {"first": mesh, "second": mesh}
    assert_problem(post("/compare?format=html", files=files), 422, "bad-request-fields")
    assert_problem(dense(shared, ids[0], "no-such-shape"), 404, "shape-not-found")
    assert_problem(dense(shared, mesh, "no-such-shape"), 404, "shape-not-found")
    assert_problem(dense(shared, mesh, ("x.txt", OTHER)), 415, "unknown-format")
    assert_problem(dense(shared, mesh, ("x.off", b"OFF\n1 1 0\n")), 422, "malformed-mesh")


def test_a_file_of_two_faces_and_an_open_file_are_answered(shared: Running, ids: tuple[str, str]) -> None:
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]], [[0, 1, 2], [0, 2, 3]])
    found = dense(shared, ("two.off", write_mesh(square, "off")), ids[0])
    assert found.status_code == 200, found.text
    assert len(found.json()["vertices"]) == 4
    ball = read_mesh(small_file(1), "off")
    low = ball.vertices[ball.faces].mean(axis=1)[:, 2] < -0.5
    half = dense(shared, ("open.off", write_mesh(Mesh(ball.vertices, ball.faces[~low]), "off")), ids[0])
    assert half.status_code == 200, half.text
    assert len(half.json()["vertices"]) == COUNT


def test_a_failing_correspondence_is_a_problem(
    shared: Running, ids: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "dense_correspondence", _failing)
    assert_problem(dense(shared, *ids), 422, "cannot-be-embedded")


def _failing(*_given: object) -> tuple[DenseCorrespondence, DenseCorrespondence]:
    raise CannotBeEmbeddedError("the method fails on this surface")
