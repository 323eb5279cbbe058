"""GLB: scenes, the layouts of arrays, and what is wrong."""

import base64
import io
import json
import struct
import zipfile

import numpy as np
import pytest

from core.errors import (
    DegenerateMeshError,
    ExternalReferenceError,
    MalformedMeshError,
    MeshTooComplexError,
    NonFiniteCoordinatesError,
    NoTrianglesError,
)
from core.io import Limits, read_mesh
from tests.core.io.files import CUBE, TRIANGLES, faulty, glb, glb_bytes, gltf
from tests.core.io.gltf_files import Gltf
from tests.core.shapes import volume

CORNERS = CUBE[TRIANGLES]
TREE, BINARY = gltf()
POSITIONS, INDICES = TREE["accessors"]
TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=float)  # a quarter around z
INSIDE = "data:application/octet-stream;base64," + base64.b64encode(BINARY).decode()
BESIDE = json.dumps({**TREE, "buffers": [{"uri": "a%20b.bin", "byteLength": len(BINARY)}]}).encode()
QUATERNION = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]


def corners(data, **limits):
    """In metres, the unit of the format."""
    mesh = read_mesh(data, "glb", limits=Limits(**limits))
    return mesh.vertices[mesh.faces] / 1e3


def zipped(files):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return data.getvalue()


def by_place(triangles):
    """Triangles in the order of their coordinates: that of instances is not promised."""
    rows = np.round(np.reshape(triangles, (-1, 9)), 6) + 0.0
    return rows[np.lexsort(rows.T)]


def moved(*by):
    return CORNERS + np.array(by)


def primitive(**changes):
    return [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, **changes}]}]


def laid_out(binary, **sections):
    """A GLB with another buffer, and the sections that describe it."""
    return glb_bytes({**TREE, "buffers": [{"byteLength": len(binary)}], **sections}, binary)


def nodes(*entries, roots=(0,)):
    return {"nodes": list(entries), "scenes": [{"nodes": list(roots)}]}


SCENES = {
    "plain": glb(),
    "mode said": glb(indices=TRIANGLES, meshes=primitive(mode=4)),
    "no indices": glb(
        positions=CORNERS.reshape(-1, 3), meshes=[{"primitives": [{"attributes": {"POSITION": 0}}]}]
    ),
    "the first scene": glb_bytes({k: v for k, v in TREE.items() if k != "scene"}, BINARY),
    "no scene": glb_bytes({k: v for k, v in TREE.items() if k not in ("scene", "scenes")}, BINARY),
    "another scene": glb(scene=1, scenes=[{}, {"nodes": [0]}]),
    "harmless extensions": glb(extensionsRequired=["KHR_mesh_quantization", "KHR_materials_unlit"]),
    "extensions not required": glb(extensionsUsed=["KHR_draco_mesh_compression"]),
    "a mesh not shown": glb(meshes=[*primitive(), {"primitives": [{"attributes": {"POSITION": 99}}]}]),
    "below a camera": glb(cameras=[{}], **nodes({"camera": 0, "children": [1]}, {"mesh": 0})),
    "meshes alone": glb_bytes(
        {k: v for k, v in TREE.items() if not k.startswith(("scene", "nodes"))}, BINARY
    ),
    "JSON with its buffers": json.dumps(
        {**TREE, "buffers": [{"uri": INSIDE, "byteLength": len(BINARY)}]}
    ).encode(),
    "a ZIP of JSON and its buffer": zipped(
        {"model/a b.bin": BINARY, "model/scene.gltf": BESIDE, "a.png": b""}
    ),
    "an image on the net": glb(images=[{"uri": "http://169.254.169.254/"}]),
    "a ZIP of another model's name": zipped({"a.model.gltf": BESIDE, "a b.bin": BINARY}),
    "a buffer elsewhere that nothing uses": glb(
        buffers=[*TREE["buffers"], {"uri": "animation.bin", "byteLength": 9}]
    ),
    "a node below two roots, one of them not shown": glb(**nodes({"mesh": 0}, {"children": [0]})),
    "nodes that are hidden": glb(
        **nodes(
            {"children": [1]},
            {"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": False}}},
            {"mesh": 0},
            roots=(0, 2),
        )
    ),
    "an image inside": glb(images=[{"uri": "data:image/png;base64,AAAA"}], materials=[{}]),
    "a buffer in base64": glb(buffers=[{"uri": INSIDE, "byteLength": len(BINARY)}]),
    "a byte more at the end": glb() + b"\n",
}


@pytest.mark.parametrize("data", SCENES.values(), ids=SCENES)
def test_reads(data):
    assert np.array_equal(corners(data), CORNERS)


@pytest.mark.parametrize(
    ("mode", "expected"), [(5, [[0, 1, 2], [3, 2, 1], [2, 3, 4]]), (6, [[0, 1, 2], [0, 2, 3], [0, 3, 4]])]
)
def test_strips_and_fans(mode, expected):
    read = corners(glb(indices=range(5), meshes=primitive(mode=mode)))
    # A triangle may begin at any of its corners, but keeps its direction.
    for triangle, wanted in zip(read, CUBE[expected], strict=True):
        assert any(np.array_equal(np.roll(triangle, i, axis=0), wanted) for i in range(3))


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_are_left_out(mode):
    both = [{"primitives": [primitive(mode=mode)[0]["primitives"][0], primitive()[0]["primitives"][0]]}]
    assert np.array_equal(corners(glb(meshes=both)), CORNERS)
    with pytest.raises(NoTrianglesError):
        corners(glb(meshes=primitive(mode=mode)))


@pytest.mark.parametrize(
    ("node", "expected"),
    [
        ({"translation": [1, 2, 3]}, moved(1, 2, 3)),
        ({"scale": [2, 3, 4]}, CORNERS * [2, 3, 4]),
        ({"rotation": QUATERNION}, CORNERS @ TURN.T),
        ({"rotation": [2 * q for q in QUATERNION]}, CORNERS @ TURN.T),
        (
            {"translation": [5, 0, 0], "rotation": QUATERNION, "scale": [2, 3, 4]},
            (CORNERS * [2, 3, 4]) @ TURN.T + [5, 0, 0],
        ),
        (
            {"matrix": [1, 0, 0, 0, 2, 1, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]},
            CORNERS @ [[1, 0, 0], [2, 1, 0], [0, 0, 1]] + [7, 8, 9],
        ),
    ],
)
def test_a_node_places_its_mesh(node, expected):
    assert corners(glb(**nodes({"mesh": 0, **node}))) == pytest.approx(expected, abs=1e-12)


def test_a_mirror_keeps_the_normals_outside():
    assert volume(read_mesh(glb(**nodes({"mesh": 0, "scale": [-1, 1, 1]})), "glb")) == pytest.approx(1e9)


def test_nodes_are_placed_by_their_parents():
    tree = nodes(
        {"translation": [10, 0, 0], "children": [1]},
        {"scale": [2, 2, 2], "children": [2, 3]},
        {"rotation": QUATERNION, "mesh": 0},
        {"translation": [0, 5, 0], "mesh": 0},
        {"mesh": 0},
        roots=(0, 4),
    )
    expected = [2 * (CORNERS @ TURN.T) + [10, 0, 0], 2 * moved(0, 5, 0) + [10, 0, 0], CORNERS]
    assert by_place(corners(glb(**tree))) == pytest.approx(by_place(expected))


def test_several_meshes_and_primitives_are_joined():
    meshes = [{"primitives": primitive()[0]["primitives"] * 2}, primitive()[0]]
    tree = nodes({"mesh": 0}, {"mesh": 1, "translation": [3, 0, 0]}, roots=(0, 1))
    read = read_mesh(glb(meshes=meshes, **tree), "glb")
    assert read.vertices.shape == (24, 3)
    expected = [CORNERS, CORNERS, moved(3, 0, 0)]
    assert np.array_equal(by_place(read.vertices[read.faces] / 1e3), by_place(expected))


def test_the_transform_of_a_skinned_node_does_not_apply():
    tree = nodes({"mesh": 0, "skin": 0, "scale": [100, 100, 100], "children": [1]}, {"mesh": 0})
    read = corners(glb(skins=[{"joints": [1]}], **tree))
    assert np.array_equal(by_place(read), by_place([CORNERS, 100 * CORNERS]))


def test_primitives_that_share_an_array_take_their_part_of_it():
    """A thousand primitives on one array of a thousand vertices are not a million vertices."""
    positions = np.random.default_rng(0).normal(size=(1000, 3)).astype(np.float32)
    indices = (np.arange(1000)[:, None] + [0, 1, 2]) % 1000
    tree, binary = gltf(positions, indices)
    tree["accessors"] = [tree["accessors"][0]] + [
        {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 3, "byteOffset": 6 * i}
        for i in range(1000)
    ]
    tree["meshes"] = [
        {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1 + i} for i in range(1000)]}
    ]
    mesh = read_mesh(glb_bytes(tree, binary), "glb")
    assert mesh.vertices.shape == (3000, 3)
    assert np.array_equal(np.float32(mesh.vertices[mesh.faces] / 1e3), positions[indices])


def test_interleaved_arrays():
    rows = np.zeros(8, dtype=[("position", "<f4", 3), ("normal", "<f4", 3)])
    rows["position"] = CUBE
    binary = b"\xff" * 4 + rows.tobytes() + TRIANGLES.astype("<u4").tobytes()
    views = [
        {"buffer": 0, "byteOffset": 4, "byteLength": rows.nbytes, "byteStride": 24},
        {"buffer": 0, "byteOffset": 4 + rows.nbytes, "byteLength": 144},
    ]
    accessors = [POSITIONS, {**INDICES, "componentType": 5125}]
    assert np.array_equal(corners(laid_out(binary, accessors=accessors, bufferViews=views)), CORNERS)


@pytest.mark.parametrize(("code", "kind"), [(5121, "<u1"), (5123, "<u2"), (5125, "<u4")])
def test_types_of_indices(code, kind):
    indices = TRIANGLES.astype(kind).tobytes()
    data = laid_out(
        CUBE.astype("<f4").tobytes() + indices,
        accessors=[POSITIONS, {**INDICES, "componentType": code}],
        bufferViews=[TREE["bufferViews"][0], {"buffer": 0, "byteOffset": 96, "byteLength": len(indices)}],
    )
    assert np.array_equal(corners(data), CORNERS)


@pytest.mark.parametrize(
    ("code", "kind", "stored", "normalised"),
    [
        (5120, "<i1", [-128, -127, 0, 63, 127], [-1, -1, 0, 63 / 127, 1]),
        (5121, "<u1", [0, 1, 51, 254, 255], [0, 1 / 255, 0.2, 254 / 255, 1]),
        (5122, "<i2", [-32768, -32767, 0, 1, 32767], [-1, -1, 0, 1 / 32767, 1]),
        (5123, "<u2", [0, 1, 13107, 65534, 65535], [0, 1 / 65535, 0.2, 65534 / 65535, 1]),
    ],
)
@pytest.mark.parametrize("flag", [True, False])
def test_quantised_positions(code, kind, stored, normalised, flag):
    """The equations of KHR_mesh_quantization; rows are padded to four bytes."""
    rows = np.zeros(5, dtype={"names": ["p"], "formats": [(kind, 3)], "offsets": [0], "itemsize": 8})
    rows["p"] = np.stack([stored, stored[::-1], np.roll(stored, 2)], axis=1)
    indices = np.array([0, 1, 2, 2, 3, 4], dtype="<u2")
    data = laid_out(
        rows.tobytes() + indices.tobytes(),
        accessors=[
            {**POSITIONS, "componentType": code, "count": 5, "normalized": flag},
            {**INDICES, "count": 6},
        ],
        bufferViews=[
            {"buffer": 0, "byteLength": 40, "byteStride": 8},
            {"buffer": 0, "byteOffset": 40, "byteLength": 12},
        ],
        extensionsRequired=["KHR_mesh_quantization"],
    )
    values = normalised if flag else stored
    expected = np.stack([values, values[::-1], np.roll(values, 2)], axis=1)
    assert read_mesh(data, "glb").vertices / 1e3 == pytest.approx(expected, rel=1e-7)


def accessor(number, **changes):
    """The sound GLB with one accessor changed; a change to None leaves the member out."""
    changed = {**TREE["accessors"][number], **changes}
    accessors = list(TREE["accessors"])
    accessors[number] = {name: value for name, value in changed.items() if value is not None}
    return glb(accessors=accessors)


def view(number, **changes):
    views = list(TREE["bufferViews"])
    views[number] = {**views[number], **changes}
    return glb(bufferViews=views)


SOUND = glb()
MALFORMED = {
    "not a GLB": b"glTf" + SOUND[4:],
    "version 1": SOUND[:4] + struct.pack("<I", 1) + SOUND[8:],
    "length too large": SOUND[:8] + struct.pack("<I", 2**32 - 1) + SOUND[12:],
    "JSON chunk too long": SOUND[:12] + struct.pack("<I", 2**32 - 1) + SOUND[16:],
    "no JSON chunk": SOUND[:16] + b"NOSJ" + SOUND[20:],
    "cut": SOUND[:-4],
    "only a header": SOUND[:12],
    "not JSON": glb_bytes(b"{'asset': 1}", BINARY),
    "not an object": glb_bytes([1, 2], BINARY),
    "deep JSON": glb_bytes(b"[" * 100_000, BINARY),
    "a number of 5,000 digits": glb_bytes(b'{"scene": ' + b"9" * 5000 + b"}", BINARY),
    "nodes not a list": glb(nodes={"0": {"mesh": 0}}),
    "nodes of numbers": glb(nodes=[0]),
    "no such scene": glb(scene=1),
    "no such node": glb(scenes=[{"nodes": [1]}]),
    "a negative node": glb(scenes=[{"nodes": [-1]}]),
    "a node by its name": glb(scenes=[{"nodes": ["a"]}]),
    "no such mesh": glb(nodes=[{"mesh": 1}]),
    "a negative mesh": glb(nodes=[{"mesh": -1}]),
    "a true mesh": glb(nodes=[{"mesh": True}]),
    "no such child": glb(nodes=[{"mesh": 0, "children": [7]}]),
    "its own child": glb(nodes=[{"mesh": 0, "children": [0]}]),
    "a circle of nodes": glb(**nodes({"children": [1]}, {"mesh": 0, "children": [0]})),
    "two parents": glb(**nodes({"children": [2]}, {"children": [2]}, {"mesh": 0}, roots=(0, 1))),
    "a root twice": glb(scenes=[{"nodes": [0, 0]}]),
    "a short matrix": glb(nodes=[{"mesh": 0, "matrix": [1, 0, 0]}]),
    "a translation of words": glb(nodes=[{"mesh": 0, "translation": ["1", 0, 0]}]),
    "a rotation of nothing": glb(nodes=[{"mesh": 0, "rotation": [0, 0, 0, 0]}]),
    "no attributes": glb(meshes=[{"primitives": [{"indices": 1}]}]),
    "no positions": glb(meshes=[{"primitives": [{"attributes": {"NORMAL": 0}, "indices": 1}]}]),
    "no such accessor": glb(meshes=primitive(indices=2)),
    "positions that are indices": glb(meshes=primitive(attributes={"POSITION": 1})),
    "indices that are positions": glb(meshes=primitive(indices=0)),
    "an accessor without data": accessor(0, bufferView=None),
    "an accessor of 7e8 without data": accessor(0, bufferView=None, count=700_000_000),
    "indices of 9e6 without data": accessor(1, bufferView=None, count=9_000_000),
    "indices of 3e9 without data": accessor(1, bufferView=None, count=3_000_000_000),
    "sparse without its indices": accessor(0, sparse={"count": 1, "indices": {}, "values": {}}),
    "no count": accessor(0, count=None),
    "a negative count": accessor(0, count=-8),
    "a fractional count": accessor(0, count=8.5),
    "more than its data": accessor(0, count=9),
    "far more than its data": accessor(0, count=2**62),
    "more indices than its data": accessor(1, count=39),
    "indices that make no triangles": accessor(1, count=35),
    "indices of a negative type": accessor(1, componentType=5122),
    "unknown type": accessor(0, componentType=5130),
    "positions in the plane": accessor(0, type="VEC2"),
    "an offset past the end": accessor(0, byteOffset=4),
    "a negative offset": accessor(0, byteOffset=-4),
    "no such view": accessor(0, bufferView=2),
    "a view longer than its buffer": view(1, byteLength=10_000),
    "a view past its buffer": view(1, byteOffset=10_000),
    "a view of no such buffer": view(0, buffer=1),
    "a stride of 0": view(0, byteStride=0),
    "a stride past the end": view(0, byteStride=252),
    "a buffer longer than the chunk": glb(buffers=[{"byteLength": 10_000}]),
    "a second buffer without data": glb(
        buffers=TREE["buffers"] * 2,
        bufferViews=[{**TREE["bufferViews"][0], "buffer": 1}, TREE["bufferViews"][1]],
    ),
    "a buffer not in base64": glb(buffers=[{"uri": "data:,abc", "byteLength": 3}]),
    "a buffer of bad base64": glb(buffers=[{"uri": "data:;base64,!!!!", "byteLength": 3}]),
    "index too large": glb(indices=[0, 1, 8]),
    "draco": glb(extensionsRequired=["KHR_draco_mesh_compression"]),
    "meshopt": glb(extensionsRequired=["EXT_meshopt_compression"]),
    "extensions not a list": glb(extensionsRequired="KHR"),
}
BAD = {
    MalformedMeshError: {
        **MALFORMED,
        "7e8 positions without indices": glb(
            accessors=[{**POSITIONS, "count": 700_000_002}],
            meshes=[{"primitives": [{"attributes": {"POSITION": 0}}]}],
        ),
    },
    NoTrianglesError: {
        "no nodes": glb(nodes=[], scenes=[{}]),
        "no meshes": glb(nodes=[{}]),
        "a mesh in another scene": glb(scenes=[{}, {"nodes": [0]}]),
        "no primitives": glb(meshes=[{"primitives": []}]),
        "no indices in the list": accessor(1, count=0),
    },
    NonFiniteCoordinatesError: {
        "NaN": glb(positions=np.where(CUBE, np.nan, 0)),
        "infinity": glb(positions=np.where(CUBE, np.inf, 0)),
        "placed at NaN": glb(nodes=[{"mesh": 0, "translation": [float("nan"), 0, 0]}]),
        "placed at infinity": glb(
            nodes=[{"mesh": 0, "scale": [1e308, 1, 1], "children": [1]}, {"mesh": 0, "scale": [1e308, 1, 1]}]
        ),
    },
    DegenerateMeshError: {
        "one point": glb(positions=np.ones((8, 3))),
        "scaled to nothing": glb(nodes=[{"mesh": 0, "scale": [0, 0, 0]}]),
    },
    ExternalReferenceError: {
        "a buffer in a file": glb(buffers=[{"uri": "file:///etc/passwd", "byteLength": 9}]),
        "a buffer in a path": glb(buffers=[{"uri": "../../a.bin", "byteLength": 9}]),
        "a buffer beside the JSON": BESIDE,
        "a buffer missing in a ZIP": zipped({"a.gltf": BESIDE}),
        "a buffer above a ZIP": zipped({"a/a.gltf": BESIDE.replace(b"a%20", b"../"), "b.bin": BINARY}),
        "a buffer on the net": glb(buffers=[{"uri": "http://a/b.bin", "byteLength": 9}]),
    },
    MeshTooComplexError: {
        "20,000 instances": glb(**nodes(*[{"mesh": 0}] * 20_000, roots=range(20_000))),
        "100,000 nodes": glb(**nodes({"mesh": 0}, *[{}] * 100_000)),
        "4,097 primitives": glb(meshes=[{"primitives": primitive()[0]["primitives"] * 4097}]),
    },
}


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (["3D/3dmodel.model"], "format 3MF, .*ending .3mf"),
        (["a.png"], "no file that ends"),
        (["a.gltf", "b.gltf"], "2 files that end"),
    ],
)
def test_a_zip_without_the_one_gltf(names, reason):
    with pytest.raises(MalformedMeshError, match=reason):
        read_mesh(zipped(dict.fromkeys(names, BESIDE)), "glb")


@faulty(BAD)
def test_bad(data, error):
    with pytest.raises(error):
        read_mesh(data, "glb")


def test_instances_count_each():
    data = glb(**nodes(*[{"mesh": 0}] * 10, roots=range(10)))
    assert len(corners(data, faces=120, vertices=80, parts=10)) == 120
    for limits in ({"faces": 119}, {"vertices": 79}, {"parts": 9}):
        with pytest.raises(MeshTooComplexError):
            corners(data, **limits)


def test_20000_instances_of_20000_faces():
    """Few bytes that stand for gigabytes."""
    data = glb(indices=np.tile(TRIANGLES, (1667, 1)), **nodes(*[{"mesh": 0}] * 4000, roots=range(4000)))
    with pytest.raises(MeshTooComplexError, match="80016000 triangles"):
        corners(data)


def test_a_deep_scene():
    chain = [{"children": [i + 1], "translation": [0.5, 0, 0]} for i in range(5000)]
    read = corners(glb(**nodes(*chain, {"mesh": 0})))
    assert np.array_equal(read, moved(2500, 0, 0))


def test_images_are_never_decoded(monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("an image was decoded")

    monkeypatch.setattr("PIL.Image.open", refuse)
    data = glb(
        images=[{"bufferView": 0, "mimeType": "image/png"}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        meshes=primitive(material=0),
    )
    assert np.array_equal(corners(data), CORNERS)


def test_messages_name_the_cause():
    with pytest.raises(MalformedMeshError, match="compressed by Draco"):
        read_mesh(glb(extensionsRequired=["KHR_draco_mesh_compression"]), "glb")
    with pytest.raises(MalformedMeshError, match="vertex 8, counted from 0, but there are 8"):
        read_mesh(glb(indices=[0, 1, 8]), "glb")
    with pytest.raises(ExternalReferenceError) as caught:
        read_mesh(glb(buffers=[{"uri": "file:///etc/passwd"}]), "glb")
    assert "/" not in str(caught.value)


def test_a_skinned_vertex_is_the_weighted_sum_of_joint_times_inverse_bind_matrix():
    gltf = Gltf()
    mesh = gltf.mesh(2 * CUBE, attributes=gltf.bound([0, 1, 0, 0], [0.25, 0.75, 0, 0]))
    first = gltf.node(translation=[8, 0, 0])
    second = gltf.node(scale=[3, 3, 3])
    gltf.node(children=[first, second], scale=[0.5, 0.5, 0.5])
    inverse = np.eye(4)
    inverse[:3, 3] = [0, 4, 0]
    # By columns.
    matrices = gltf.accessor([np.eye(4).T.ravel(), inverse.T.ravel()])
    gltf.tree["skins"] = [{"joints": [first, second], "inverseBindMatrices": matrices}]
    # The transform of the node itself does not count.
    gltf.node(mesh=mesh, skin=0, translation=[99, 0, 0])
    expected = 0.25 * 0.5 * (2 * CORNERS + [8, 0, 0]) + 0.75 * 0.5 * 3 * (2 * CORNERS + [0, 4, 0])
    assert corners(gltf.data()) == pytest.approx(expected)


def test_a_skin_without_matrices_that_mirrors_keeps_faces_outwards():
    gltf = Gltf()
    mesh = gltf.mesh(attributes=gltf.bound([0, 0, 0, 0], [2, 0, 0, 0]))
    gltf.tree["skins"] = [{"joints": [gltf.node(scale=[-1, 1, 1])]}]
    gltf.node(mesh=mesh, skin=0)
    assert volume(read_mesh(gltf.data(), "glb")) == pytest.approx(1e9)


@pytest.mark.parametrize("of_node", [True, False])
def test_default_weights_of_morph_targets(of_node):
    gltf = Gltf()
    targets = [{"POSITION": gltf.accessor(CUBE * [1, 0, 0])}, {"POSITION": gltf.accessor(CUBE * [0, 2, 0])}]
    mesh = gltf.mesh(primitive={"targets": targets}, weights=[0, 1] if of_node else [1, 0.5])
    gltf.node(mesh=mesh, **({"weights": [1, 0.5]} if of_node else {}))
    assert corners(gltf.data()) == pytest.approx(CORNERS * [2, 2, 1])


def test_copies_of_a_node_are_placed_each():
    gltf = Gltf()
    attributes = {
        "TRANSLATION": gltf.accessor([[0, 0, 0], [10, 0, 0]]),
        "SCALE": gltf.accessor([[1, 1, 1], [2, 2, 2]]),
        "ROTATION": gltf.accessor([[0, 0, 0, 1], QUATERNION]),
    }
    gltf.node(mesh=gltf.mesh(), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    turned = 2 * CORNERS @ TURN.T + [10, 0, 0]
    assert by_place(corners(gltf.data())) == pytest.approx(by_place([*CORNERS, *turned]), abs=1e-6)


@pytest.mark.parametrize("stored", [True, False])
def test_sparse_accessors(stored):
    gltf = Gltf()
    changed = np.array([1, 6], dtype="<u2") if stored else np.arange(8, dtype="<u2")
    values = CUBE[changed].astype("<f4")
    sparse = {
        "count": len(changed),
        "indices": {"bufferView": gltf.view(changed), "componentType": 5123},
        "values": {"bufferView": gltf.view(values)},
    }
    wrong = np.where(np.isin(np.arange(8), [1, 6])[:, None], 7.0, CUBE)
    number = gltf.accessor(wrong, sparse=sparse)
    if not stored:
        del gltf.tree["accessors"][number]["bufferView"]
    indices = gltf.accessor(TRIANGLES.reshape(-1, 1), "<u2")
    gltf.tree["meshes"] = [{"primitives": [{"attributes": {"POSITION": number}, "indices": indices}]}]
    gltf.node(mesh=0)
    assert np.array_equal(corners(gltf.data()), CORNERS)
