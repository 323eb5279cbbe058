"""Cases of glTF alone: files that stand for far more than they hold, cycles, references to other files."""

import base64
import json
import struct
import zlib

import numpy as np

from tests.core.io.files import CUBE, TRIANGLES, glb, glb_bytes, gltf
from tests.soak.hostile.bodies import sheet
from tests.soak.hostile.case import Hostile, malformed, refused, stored

HUGE = 700_000_000


def cases() -> list[Hostile]:
    """All of them."""
    return [*_without_data(), *_instances(), *_textures(), *_references(), *_documents()]


def _accessors(positions: dict, indices: dict) -> bytes:
    """A cube whose two accessors have changed, an entry of None being left out."""
    tree, binary = gltf()
    for accessor, changes in zip(tree["accessors"], (positions, indices), strict=True):
        accessor.update(changes)
    tree["accessors"] = [
        {name: value for name, value in accessor.items() if value is not None}
        for accessor in tree["accessors"]
    ]
    return glb_bytes(tree, binary)


def _without_data() -> list[Hostile]:
    sparse = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}
    return malformed(
        "no-view",
        {
            "no-view-positions.glb": _accessors({"bufferView": None, "count": HUGE}, {}),
            "no-view-indices.glb": _accessors({}, {"bufferView": None, "count": 3 * HUGE}),
            "no-view-both.glb": _accessors(
                {"bufferView": None, "count": HUGE}, {"bufferView": None, "count": HUGE}
            ),
            "no-view-alone.glb": glb_bytes(
                {
                    **gltf()[0],
                    "buffers": [],
                    "bufferViews": [],
                    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                    "accessors": [{"componentType": 5126, "type": "VEC3", "count": HUGE}],
                }
            ),
            "no-view-sparse.glb": _accessors({"bufferView": None, "count": HUGE, "sparse": sparse}, {}),
            "count-positions.glb": _accessors({"count": HUGE}, {}),
            "count-indices.glb": _accessors({}, {"count": HUGE}),
            "count-negative.glb": _accessors({"count": -1}, {}),
            "count-fraction.glb": _accessors({"count": 8.5}, {}),
            "count-text.glb": _accessors({"count": "8"}, {}),
            "count-true.glb": _accessors({"count": True}, {}),
            "offset-past-the-end.glb": _accessors({"byteOffset": 1 << 40}, {}),
            "view-not-there.glb": _accessors({"bufferView": 99}, {}),
            "type-of-matrices.glb": _accessors({"type": "MAT4"}, {}),
            "component-unknown.glb": _accessors({"componentType": 5130}, {}),
            "buffer-long.glb": glb(buffers=[{"byteLength": 1 << 40}]),
            "stride-zero.glb": glb(bufferViews=[{"buffer": 0, "byteLength": 96, "byteStride": 0}] * 2),
        },
    )


def _instances() -> list[Hostile]:
    return [
        *refused(
            "instances", "mesh-too-complex", {"instances.glb": _many_instances, "primitives.glb": _primitives}
        ),
        *refused("parts", "mesh-too-complex", {"primitives-20000.glb": lambda: _primitives(20_000)}),
        *malformed(
            "instances",
            {
                "node-in-itself.glb": glb(nodes=[{"mesh": 0, "children": [0]}]),
                "node-circle.glb": glb(nodes=[{"children": [1]}, {"mesh": 0, "children": [0]}]),
                "node-shared.glb": glb(nodes=[{"children": [1, 1]}, {"mesh": 0}]),
                "node-doubling.glb": glb(
                    nodes=[*({"children": [i + 1, i + 1]} for i in range(60)), {"mesh": 0}]
                ),
                "node-missing.glb": glb(nodes=[{"children": [7]}]),
                "mesh-missing.glb": glb(nodes=[{"mesh": 7}]),
                "scene-missing.glb": glb(scene=3),
            },
        ),
        *stored(
            "instances",
            {"node-chain.glb": glb(nodes=[*({"children": [i + 1]} for i in range(20_000)), {"mesh": 0}])},
        ),
    ]


def _many_instances() -> bytes:
    """20,000 instances of 20,000 faces in less than two megabytes."""
    count = 20_000
    nodes = [{"mesh": 0, "translation": [i, 0, 0]} for i in range(count)]
    return glb(*sheet(101), nodes=nodes, scenes=[{"nodes": list(range(count))}])


def _primitives(count: int = 4_000) -> bytes:
    """One mesh whose primitives all share 20,000 faces."""
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    return glb(*sheet(101), meshes=[{"primitives": [primitive] * count}])


def _png(side: int) -> bytes:
    """A black picture of one bit a pixel: 40,000 x 40,000 are 1.6 GB once decoded to bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9)
    row = bytes(1 + side // 8)
    pixels = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def _textured(picture: bytes) -> bytes:
    """A cube with a picture in its buffer, and coordinates to put it on."""
    tree, binary = gltf()
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(picture)})
    tree["buffers"] = [{"byteLength": len(binary) + len(picture)}]
    tree["images"] = [{"bufferView": 2, "mimeType": "image/png"}]
    tree |= {"textures": [{"source": 0}], "samplers": [{}]}
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    primitive = tree["meshes"][0]["primitives"][0]
    primitive |= {"material": 0}
    primitive["attributes"]["TEXCOORD_0"] = 0
    return glb_bytes(tree, binary + picture)


def _textures() -> list[Hostile]:
    data = "data:image/png;base64," + base64.b64encode(_png(64)).decode()
    return stored(
        "texture",
        {
            "texture-40000.glb": lambda: _textured(_png(40_000)),
            "texture-broken.glb": _textured(b"\x89PNG\r\n\x1a\nno picture"),
            "texture-empty.glb": _textured(b""),
            "texture-in-uri.glb": glb(images=[{"uri": data}]),
            "texture-missing.glb": glb(
                materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 9}}}]
            ),
        },
    )


def _references() -> list[Hostile]:
    addresses = {
        "file": "file:///etc/passwd",
        "root": "/etc/passwd",
        "parent": "../../../../etc/passwd",
        "http": "http://127.0.0.1:1/mesh.bin",
        "https": "https://example.org/mesh.bin",
        "share": "\\\\server\\share\\mesh.bin",
        "ftp": "ftp://example.org/mesh.bin",
        "plain": "mesh.bin",
        "empty": "",
        "capitals": "FILE:///etc/passwd",
    }
    buffers = {
        f"buffer-{name}.glb": glb(buffers=[{"byteLength": 168, "uri": uri}])
        for name, uri in addresses.items()
    }
    images = {
        f"image-{name}.glb": glb(images=[{"uri": addresses[name]}])
        for name in ("file", "parent", "http", "plain")
    }
    broken = {
        "uri-not-base64.glb": glb(buffers=[{"byteLength": 168, "uri": "data:;base64,@@@@"}]),
        "uri-not-coded.glb": glb(buffers=[{"byteLength": 4, "uri": "data:text/plain,abcd"}]),
        "uri-short.glb": glb(buffers=[{"byteLength": 1 << 30, "uri": "data:;base64,AAAA"}]),
        "compressed.glb": glb(extensionsRequired=["KHR_draco_mesh_compression"]),
    }
    return [
        *refused("reference", "external-reference", {**buffers, **images}),
        *malformed("reference", broken),
    ]


def _documents() -> list[Hostile]:
    """JSON that is deep, long, or not what it should be."""
    tree, binary = gltf()
    text = json.dumps(tree)
    deep = text[:-1] + ', "extras": ' + "[" * 100_000 + "]" * 100_000 + "}"
    long = text[:-1] + ', "extras": ' + "9" * 50_000 + "}"
    cut = glb()
    return [
        *malformed(
            "nested",
            {
                "json-deep.glb": glb_bytes(deep.encode(), binary),
                "json-of-brackets.glb": glb_bytes(b"[" * 1_000_000),
                "json-long-number.glb": glb_bytes(long.encode(), binary),
                "json-list.glb": glb_bytes([]),
                "json-null.glb": glb_bytes(b"null"),
                "json-nan-matrix.glb": glb(nodes=[{"mesh": 0, "matrix": [None] * 16}]),
                "json-sections.glb": glb(accessors={}, meshes=7),
                "json-not-utf8.glb": glb_bytes(b'{"asset": "\xff\xfe"}'),
                "chunk-length.glb": cut[:12] + b"\xff\xff\xff\xff" + cut[16:],
                "length-most.glb": cut[:8] + b"\xff\xff\xff\xff" + cut[12:],
                "version-one.glb": cut[:4] + b"\x01\0\0\0" + cut[8:],
            },
        ),
        *refused(
            "non-finite",
            "non-finite-coordinates",
            {"json-nan-scale.glb": glb(nodes=[{"mesh": 0, "scale": [float("nan"), 1, 1]}])},
        ),
        *refused(
            "no-faces",
            "no-triangles",
            {
                "points.glb": glb(meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}]),
                "lines.glb": glb(meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 1}]}]),
                "no-nodes.glb": glb(nodes=[], scenes=[{"nodes": []}]),
                "no-meshes.glb": glb(nodes=[{}]),
            },
        ),
        *refused(
            "degenerate", "degenerate-mesh", {"scale-zero.glb": glb(nodes=[{"mesh": 0, "scale": [0, 0, 0]}])}
        ),
        *stored(
            "strange",
            {
                "strip.glb": glb(
                    indices=np.array([0, 1, 2, 3, 6, 7, 4, 5]),
                    meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 5}]}],
                ),
                "scale-negative.glb": glb(CUBE, TRIANGLES, nodes=[{"mesh": 0, "scale": [-1, 2, 1]}]),
            },
        ),
    ]
