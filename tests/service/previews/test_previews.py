"""Pictures: what they show, that they are kept, and what a browser is told of them."""

import json
import struct
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from sqlalchemy import update

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.rendering.colours import colours_of_points, interpolate_colours
from service.rendering.tasks import FACES, GlbPart, write_glb
from service.rendering.tasks import preview as make_preview
from service.rendering.thumbnail import NOTHING, SIZES, camera, draw, nearest_triangles, upright
from service.storage.checksums import checksum_of
from service.storage.tables import ThumbnailRow
from tests.core.shapes import icosphere
from tests.service.engines import on_both
from tests.service.support import Running, assert_problem, small_file


def plain_nearest(corners: np.ndarray, size: int) -> np.ndarray:
    """Which triangle is nearest at each pixel, by solving for each of them."""
    seen = np.full((size, size), NOTHING)
    for i in range(size):
        for j in range(size):
            best = -np.inf
            for f, triangle in enumerate(corners):
                system = np.vstack([triangle[:, :2].T, np.ones(3)])
                shares = np.linalg.solve(system, [j + 0.5, i + 0.5, 1.0])
                if shares.min() >= 0 and shares @ triangle[:, 2] > best:
                    best = shares @ triangle[:, 2]
                    seen[i, j] = f
    return seen


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(BytesIO(png)).convert("RGBA")).astype(float)


def read_glb(data: bytes) -> tuple[dict, list[np.ndarray], list[np.ndarray]]:
    """The tree of a GLB, and the positions and colours of its meshes, read anew."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    (size,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + size])

    def array(number: int) -> np.ndarray:
        accessor = tree["accessors"][number]
        view = tree["bufferViews"][accessor["bufferView"]]
        kind = {5121: "u1", 5126: "<f4"}[accessor["componentType"]]
        start = 28 + size + view["byteOffset"]
        return np.frombuffer(data[start : start + view["byteLength"]], kind).reshape(accessor["count"], -1)

    attributes = [mesh["primitives"][0]["attributes"] for mesh in tree["meshes"]]
    colours = [array(each["COLOR_0"]) for each in attributes if "COLOR_0" in each]
    return tree, [array(each["POSITION"]) for each in attributes], colours


@pytest.mark.parametrize("seed", range(2))
def test_the_triangle_at_each_pixel_is_the_nearest(seed: int) -> None:
    size = 24
    corners = np.random.default_rng(seed).uniform(-8, size + 8, size=(12, 3, 3))
    assert np.array_equal(nearest_triangles(corners, size), plain_nearest(corners, size))


@pytest.mark.parametrize("seed", range(3))
def test_the_needle_at_each_pixel_is_the_nearest(seed: int) -> None:
    """Triangles far longer than wide, some of them level or upright."""
    rng, size = np.random.default_rng(seed), 24
    start, end = rng.uniform(-8, size + 8, size=(2, 40, 3))
    end[:8, 0], end[8:16, 1] = start[:8, 0], start[8:16, 1]
    corners = np.stack([start, end, end + rng.uniform(-2, 2, size=(40, 3))], axis=1)
    assert np.array_equal(nearest_triangles(corners, size), plain_nearest(corners, size))


def test_triangles_without_area_are_not_seen() -> None:
    line = np.array([[[1.0, 1, 0], [5, 5, 0], [9, 9, 0]]])
    assert (nearest_triangles(line, 10) == NOTHING).all()


@pytest.mark.parametrize("size", SIZES[::3])
def test_a_ball_is_drawn_as_a_disc(size: int) -> None:
    drawn = pixels(draw(icosphere(5), "off", size))
    assert drawn.shape == (size, size, 4)
    # Its diameter is 92 % of the picture's side.
    assert drawn[..., 3].sum() / 255 == pytest.approx(np.pi / 4 * (0.92 * size) ** 2, rel=0.01)
    assert drawn[0, 0, 3] == drawn[-1, -1, 3] == 0
    # Lit from the upper left.
    at = size // 4
    assert drawn[at, at, :3].sum() > drawn[-at, -at, :3].sum()


def test_faces_in_front_hide_faces_behind() -> None:
    towards = camera()[2] @ upright("off")
    inner = icosphere(3)
    # A larger ball, nearer to the eye, hides the small one.
    both = Mesh(
        np.vstack([0.2 * inner.vertices - 3 * towards, inner.vertices]),
        np.vstack([inner.faces, inner.faces + len(inner.vertices)]),
    )
    alone = pixels(draw(inner, "off", 64))
    assert np.abs(pixels(draw(both, "off", 64)) - alone).mean() < 2.0


def test_up_is_z_and_in_obj_and_glb_y() -> None:
    turned = Mesh(icosphere(2).vertices * [1, 2, 3], icosphere(2).faces)
    standing = Mesh(turned.vertices @ upright("ply").T, turned.faces)
    assert draw(turned, "ply", 64) == draw(standing, "obj", 64)
    tall = pixels(draw(turned, "stl", 64))[..., 3].any(axis=1).sum()
    wide = pixels(draw(turned, "stl", 64))[..., 3].any(axis=0).sum()
    assert tall > wide


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_units_do_not_matter(scale: float) -> None:
    mesh = icosphere(2)
    moved = Mesh(scale * (mesh.vertices + 5), mesh.faces)
    assert np.abs(pixels(draw(moved, "off", 64)) - pixels(draw(mesh, "off", 64))).mean() < 1.0
    tree, (points,), _ = read_glb(make_preview(moved, "off", FACES))
    extras = tree["nodes"][0]["extras"]
    back = points.astype(float) * extras["half"] + np.array(extras["middle"])
    assert np.abs(back / scale - (mesh.vertices + 5)).max() < 1e-6


def test_a_preview_is_a_glb_that_is_read_upright() -> None:
    mesh = Mesh(icosphere(2).vertices * [1, 2, 3], icosphere(2).faces)
    read = read_mesh(make_preview(mesh, "stl", FACES), "glb")
    assert np.array_equal(read.faces, mesh.faces)
    assert np.abs(read.vertices / 1e3 - mesh.vertices @ upright("stl").T / 3).max() < 1e-6


def test_a_large_mesh_is_simplified_though_its_faces_share_no_vertices() -> None:
    mesh = icosphere(5)
    soup = Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))
    shown = read_mesh(make_preview(soup, "stl", 2_000), "glb")
    assert 1_000 < len(shown.faces) <= 2_200
    assert np.abs(np.linalg.norm(shown.vertices, axis=1) / 1e3 - 1).max() < 0.02


def test_points_give_their_colour_to_what_is_near() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(30, 3))
    colours = colours_of_points(points, np.eye(3))
    assert colours.min() == pytest.approx(0.1)
    assert colours.max() == pytest.approx(1.0)
    assert np.array_equal(np.argsort(colours[:, 0]), np.argsort(points[:, 0]))
    painted = interpolate_colours(points, colours, points)
    assert np.abs(painted[:, :3] - 255 * colours).max() <= 1
    # Half way between two points that are far from all others.
    two = interpolate_colours(
        np.array([[0.0, 0, 0], [2, 0, 0], [1, 999, 0]]), np.eye(3), np.array([[1.0, 0, 0]])
    )
    assert two.tolist() == [[127, 127, 0, 255]] or two.tolist() == [[128, 128, 0, 255]]


def test_parts_lie_side_by_side() -> None:
    mesh = icosphere(2)
    part = GlbPart("one", "off", mesh)
    across = np.sort(read_mesh(write_glb([part, part]), "glb").vertices[:, 0]) / 1e3
    left, right = across[: len(mesh.vertices)], across[len(mesh.vertices) :]
    assert right.min() - left.max() > 0.3
    assert np.ptp(left) == pytest.approx(np.ptp(right)) == pytest.approx(2.0)


@on_both
def test_a_thumbnail_is_drawn_once_and_kept(service: Running) -> None:
    shape = service.store(small_file(1))
    address = f"/shapes/{shape['id']}/thumbnail.png"
    answer = service.client.get(address, params={"size": 128})
    assert answer.headers["content-type"] == "image/png"
    assert answer.content == draw(read_mesh(small_file(1), "off"), "off", 128)
    with service.container.database.write() as session:
        session.execute(update(ThumbnailRow).values(data=b"kept", checksum=checksum_of(b"kept")))
    assert service.client.get(address, params={"size": 128}).content == b"kept"
    # Another shape on the same bytes has the same picture, and another size is another picture.
    twin = service.store(small_file(1), name="twin.off")
    assert service.client.get(f"/shapes/{twin['id']}/thumbnail.png?size=128").content == b"kept"
    assert pixels(service.client.get(address).content).shape == (256, 256, 4)
    # A damaged one is drawn anew, and one that an older version drew.
    with service.container.database.write() as session:
        session.execute(update(ThumbnailRow).values(data=b"damaged"))
    assert service.client.get(address, params={"size": 128}).content == answer.content
    with service.container.database.write() as session:
        session.execute(update(ThumbnailRow).values(drawing=0))
    assert service.client.get(address, params={"size": 128}).content == answer.content


@on_both
def test_a_thumbnail_goes_with_the_last_shape_that_has_the_file(service: Running) -> None:
    ids = [service.store(small_file(2), name=name)["id"] for name in ("a.off", "b.off")]
    assert service.client.get(f"/shapes/{ids[0]}/thumbnail.png").status_code == 200

    for shape_id, left in zip(ids, (1, 0), strict=True):
        service.client.delete(f"/shapes/{shape_id}")
        assert service.rows(ThumbnailRow) == left


@pytest.mark.parametrize("what", ["thumbnail.png", "preview.glb"])
def test_a_browser_that_has_a_picture_is_not_sent_it_again(service: Running, what: str) -> None:
    address = f"/shapes/{service.store(small_file(3))['id']}/{what}"
    first = service.client.get(address)
    assert first.headers["cache-control"] == "private, no-cache"
    again = service.client.get(address, headers={"if-none-match": first.headers["etag"]})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", first.headers["etag"])


@pytest.mark.parametrize("what", ["thumbnail.png", "preview.glb", "view"])
def test_a_shape_that_is_not_there_has_no_picture(service: Running, what: str) -> None:
    assert_problem(service.client.get(f"/shapes/no-such-shape/{what}"), 404, "shape-not-found")


@pytest.mark.parametrize("size", ["100", "x"])
def test_other_sizes_are_not_drawn(service: Running, size: str) -> None:
    shape = service.store(small_file(1))
    answer = service.client.get(f"/shapes/{shape['id']}/thumbnail.png", params={"size": size})
    assert_problem(answer, 422, "bad-request-fields")


def test_a_file_is_previewed_as_a_stored_shape_is(service: Running) -> None:
    shape = service.store(small_file(4))
    stored = service.client.get(f"/shapes/{shape['id']}/preview.glb")
    sent = service.client.post("/preview", files={"file": ("x.off", small_file(4))})
    assert sent.headers["content-type"] == stored.headers["content-type"] == "model/gltf-binary"
    assert sent.content == stored.content
    bad = service.client.post("/preview", files={"file": ("x.off", b"OFF\n1 1 0\n")})
    assert_problem(bad, 422, "malformed-mesh")
    assert service.client.get("/shapes").json()["total"] == 1


def test_a_comparison_is_drawn_with_corresponding_points_alike(service: Running) -> None:
    mesh = read_mesh(small_file(5), "off")
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    other = write_mesh(Mesh(3 * mesh.vertices @ turn.T, mesh.faces), "off")
    first, second = service.store(small_file(5)), service.store(other, name="turned.off")
    pair = {"first": first["id"], "second": second["id"]}
    answer = service.client.post("/compare", params={"format": "glb"}, json=pair)
    tree, points, (one, two) = read_glb(answer.content)
    assert [node["name"] for node in tree["nodes"]] == ["shape.off", "turned.off"]
    # The second is the first turned: its vertices have the colours of the same vertices.
    assert np.abs(points[1] - points[0] @ turn.T).max() < 1e-5
    assert np.abs(one.astype(int) - two).max(axis=1).mean() < 8
    assert np.ptp(one[:, :3], axis=0).min() > 150


def test_a_comparison_as_a_page_names_both_shapes(service: Running) -> None:
    ids = [service.store(small_file(number), name=f"{number}.off")["id"] for number in (6, 7)]
    pair = {"first": ids[0], "second": ids[1]}
    answer = service.client.post("/compare", params={"format": "html"}, json=pair)
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert answer.headers["content-security-policy"].startswith("default-src 'none'")
    assert f'data-first="{ids[0]}" data-second="{ids[1]}"' in answer.text
    assert "../" not in answer.text
    assert_problem(service.client.post("/compare?format=pdf", json=pair), 422, "bad-request-fields")


def test_a_page_of_two_shapes_is_that_of_the_first_beside_the_second(service: Running) -> None:
    ids = [service.store(small_file(number), name=f"{number}.off")["id"] for number in (6, 7)]
    address = f"/shapes/{ids[0]}/view"
    assert service.client.get(address, params={"beside": ids[1]}).text == service.client.get(address).text
    assert_problem(service.client.get(address, params={"beside": "none"}), 404, "shape-not-found")
    assert_problem(service.client.get(address, params={"beside": ids}), 422, "bad-request-fields")


def test_a_query_tells_of_its_own_embedding_if_asked(service: Running) -> None:
    shape = service.store(small_file(8))
    stored = service.client.get(f"/shapes/{shape['id']}/embedding").json()
    for given in ({"files": {"file": ("x.off", small_file(8))}}, {"json": {"shape_id": shape["id"]}}):
        asked = service.client.post("/query", params={"embedding": "true"}, **given).json()
        assert asked["embedding"] == stored
        assert service.client.post("/query", **given).json()["embedding"] is None
