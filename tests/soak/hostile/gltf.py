"""Cases of glTF alone: files that stand for far more than they hold, cycles, references to other files."""

import base64
import json
import struct
import zlib
from typing import Any

import numpy as np

from tests.core.io.files import CUBE, TRIANGLES, glb, glb_bytes, gltf
from tests.core.shapes import rectangle

HUGE = 700_000_000
NO_VIEW = {"bufferView": None, "count": HUGE}
SHEET = rectangle(1, 1, 100, 100)
"""20,000 faces."""


def _accessors(positions: dict[str, Any], indices: dict[str, Any]) -> bytes:
    """Return a cube whose two accessors are changed, without the entries of None."""
    tree, binary = gltf()
    tree["accessors"] = [
        {name: value for name, value in (accessor | changes).items() if value is not None}
        for accessor, changes in zip(tree["accessors"], (positions, indices), strict=True)
    ]
    return glb_bytes(tree, binary)


def _instances(count: int = 20_000) -> bytes:
    """Return 20,000 instances of 20,000 faces in less than two megabytes."""
    nodes = [{"mesh": 0, "translation": [i, 0, 0]} for i in range(count)]
    return glb(SHEET.vertices, SHEET.faces, nodes=nodes, scenes=[{"nodes": list(range(count))}])


def _primitives(count: int) -> bytes:
    """Return one mesh whose primitives all share 20,000 faces."""
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    return glb(SHEET.vertices, SHEET.faces, meshes=[{"primitives": [primitive] * count}])


def _alone(**primitive: Any) -> bytes:
    """Return a mesh whose primitive has vertices and no indices, unless given."""
    return glb(meshes=[{"primitives": [{"attributes": {"POSITION": 0}, **primitive}]}])


def _png(side: int) -> bytes:
    """Return a black picture of one bit a pixel: 40,000 x 40,000 are 1.6 GB once decoded to bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9)
    pixels = b"".join(packer.compress(bytes(1 + side // 8)) for _ in range(side)) + packer.flush()
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def _textured(picture: bytes) -> bytes:
    """Return a cube with a picture in its buffer, and coordinates to put it on."""
    tree, binary = gltf()
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(picture)})
    tree |= {
        "buffers": [{"byteLength": len(binary) + len(picture)}],
        "images": [{"bufferView": 2, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "samplers": [{}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    }
    primitive = tree["meshes"][0]["primitives"][0]
    primitive |= {"material": 0, "attributes": {**primitive["attributes"], "TEXCOORD_0": 0}}
    return glb_bytes(tree, binary + picture)


ADDRESSES = {
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
BROKEN_BUFFERS = {
    "long": {"byteLength": 1 << 40},
    "not-base64": {"byteLength": 168, "uri": "data:;base64,@@@@"},
    "not-coded": {"byteLength": 4, "uri": "data:text/plain,abcd"},
    "short": {"byteLength": 1 << 30, "uri": "data:;base64,AAAA"},
}
TREES = {
    "in-itself": [{"mesh": 0, "children": [0]}],
    "circle": [{"children": [1]}, {"mesh": 0, "children": [0]}],
    "shared": [{"children": [1, 1]}, {"mesh": 0}],
    "doubling": [*({"children": [i + 1, i + 1]} for i in range(60)), {"mesh": 0}],
    "missing": [{"children": [7]}],
    "without-its-mesh": [{"mesh": 7}],
}
TREE, BINARY = gltf()
TEXT, WHOLE = json.dumps(TREE)[:-1], glb()

CASES = {
    ("no-view", "malformed-mesh"): {
        "no-view-positions.glb": _accessors(NO_VIEW, {}),
        "no-view-indices.glb": _accessors({}, NO_VIEW | {"count": 3 * HUGE}),
        "no-view-both.glb": _accessors(NO_VIEW, NO_VIEW),
        "no-view-alone.glb": glb_bytes(
            {
                **TREE,
                "buffers": [],
                "bufferViews": [],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                "accessors": [{"componentType": 5126, "type": "VEC3", "count": HUGE}],
            }
        ),
        "count-indices.glb": _accessors({}, {"count": HUGE}),
        **{
            f"accessor-{number}.glb": _accessors(positions, {})
            for number, positions in enumerate(
                [
                    *({"count": count} for count in (HUGE, -1, 8.5, "8", True)),
                    {"byteOffset": 1 << 40},
                    {"bufferView": 99},
                    {"type": "MAT4"},
                    {"componentType": 5130},
                ]
            )
        },
        "stride-zero.glb": glb(bufferViews=[{"buffer": 0, "byteLength": 96, "byteStride": 0}] * 2),
    },
    ("instances", "mesh-too-complex"): {
        "instances.glb": _instances,
        "primitives.glb": lambda: _primitives(4_000),
    },
    ("parts", "mesh-too-complex"): {"primitives-20000.glb": lambda: _primitives(20_000)},
    ("instances", "malformed-mesh"): {
        **{f"node-{name}.glb": glb(nodes=nodes) for name, nodes in TREES.items()},
        "scene-missing.glb": glb(scene=3),
    },
    ("instances", ""): {
        "node-chain.glb": glb(nodes=[*({"children": [i + 1]} for i in range(20_000)), {"mesh": 0}])
    },
    ("texture", ""): {
        "texture-40000.glb": lambda: _textured(_png(40_000)),
        "texture-broken.glb": _textured(b"\x89PNG\r\n\x1a\nno picture"),
        "texture-empty.glb": _textured(b""),
        "texture-in-uri.glb": glb(
            images=[{"uri": "data:image/png;base64," + base64.b64encode(_png(64)).decode()}]
        ),
        "texture-missing.glb": glb(materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 9}}}]),
    },
    ("reference", "external-reference"): {
        **{f"buffer-{n}.glb": glb(buffers=[{"byteLength": 168, "uri": uri}]) for n, uri in ADDRESSES.items()}
    },
    # Pictures are not looked for.
    ("reference", ""): {
        f"image-{n}.glb": glb(images=[{"uri": ADDRESSES[n]}]) for n in ("file", "parent", "http", "plain")
    },
    ("reference", "malformed-mesh"): {
        **{f"uri-{name}.glb": glb(buffers=[buffer]) for name, buffer in BROKEN_BUFFERS.items()},
        "compressed.glb": glb(extensionsRequired=["KHR_draco_mesh_compression"]),
    },
    ("nested", "malformed-mesh"): {
        "json-deep.glb": glb_bytes(f'{TEXT}, "extras": {"[" * 100_000}{"]" * 100_000}}}'.encode(), BINARY),
        "json-of-brackets.glb": glb_bytes(b"[" * 1_000_000),
        "json-long-number.glb": glb_bytes(f'{TEXT}, "extras": {"9" * 50_000}}}'.encode(), BINARY),
        "json-list.glb": glb_bytes([]),
        "json-null.glb": glb_bytes(b"null"),
        "json-nan-matrix.glb": glb(nodes=[{"mesh": 0, "matrix": [None] * 16}]),
        "json-sections.glb": glb(accessors={}, meshes=7),
        "json-not-utf8.glb": glb_bytes(b'{"asset": "\xff\xfe"}'),
        "chunk-length.glb": WHOLE[:12] + b"\xff\xff\xff\xff" + WHOLE[16:],
        "length-most.glb": WHOLE[:8] + b"\xff\xff\xff\xff" + WHOLE[12:],
        "version-one.glb": WHOLE[:4] + b"\x01\0\0\0" + WHOLE[8:],
    },
    ("non-finite", "non-finite-coordinates"): {
        "json-nan-scale.glb": glb(nodes=[{"mesh": 0, "scale": [float("nan"), 1, 1]}])
    },
    ("no-faces", "no-triangles"): {
        "points.glb": _alone(mode=0),
        "lines.glb": _alone(mode=1),
        "no-nodes.glb": glb(nodes=[], scenes=[{"nodes": []}]),
        "no-meshes.glb": glb(nodes=[{}]),
    },
    ("degenerate", "degenerate-mesh"): {"scale-zero.glb": glb(nodes=[{"mesh": 0, "scale": [0, 0, 0]}])},
    # All positions but one are zero, and no memory is taken for them.
    ("no-view", "degenerate-mesh"): {
        "no-view-sparse.glb": _accessors(
            NO_VIEW
            | {
                "sparse": {
                    "count": 1,
                    "indices": {"bufferView": 1, "componentType": 5123},
                    "values": {"bufferView": 0},
                }
            },
            {},
        )
    },
    ("strange", ""): {
        "strip.glb": glb(
            indices=np.array([0, 1, 2, 3, 6, 7, 4, 5]),
            meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 5}]}],
        ),
        "scale-negative.glb": glb(CUBE, TRIANGLES, nodes=[{"mesh": 0, "scale": [-1, 2, 1]}]),
    },
}
