"""Small files of every format, sound and otherwise, made byte by byte."""

import json
import struct

import numpy as np
import pytest

PLAIN = ("stl", "obj", "ply", "off", "glb")
"""The formats whose files are no ZIP and need no package of their own."""

# A unit cube: eight corners, and six squares wound so that their normals point outwards.
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SQUARES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
# Its triangles, as fans around each square's first corner.
TRIANGLES = SQUARES[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def faulty(tables):
    """Give a test `data` and `error`, from tables of files by the error that refuses them."""
    cases = [
        pytest.param(data, error, id=name) for error, files in tables.items() for name, data in files.items()
    ]
    return pytest.mark.parametrize(("data", "error"), cases)


def lines(rows, before=""):
    return "".join(before + " ".join(str(value) for value in row) + "\n" for row in rows)


def counted(rows):
    """Rows with their length in front."""
    return [[len(row), *row] for row in rows]


def off(vertices=CUBE, polygons=SQUARES, header="OFF\n", counts=None):
    declared = counts or (len(vertices), len(polygons), 0)
    return (header + lines([declared]) + lines(vertices) + lines(counted(polygons))).encode()


def obj(vertices=CUBE, polygons=SQUARES):
    return (lines(vertices, "v ") + lines([[i + 1 for i in row] for row in polygons], "f ")).encode()


def stl(triangles, name="cube"):
    """ASCII."""
    facets = "".join(
        "facet normal 0 0 1\n  outer loop\n" + lines(corners, "    vertex ") + "  endloop\nendfacet\n"
        for corners in triangles
    )
    return f"solid {name}\n{facets}endsolid {name}\n".encode()


def binary_stl(triangles, header=b"", count=None):
    facets = b"".join(struct.pack("<12fH", 0, 0, 1, *np.ravel(corners), 0) for corners in triangles)
    return header.ljust(80, b" ") + struct.pack("<I", len(triangles) if count is None else count) + facets


def ply_header(vertices, faces, form="ascii", vertex=("float x", "float y", "float z"), face=(), more=()):
    face = face or ("list uchar int vertex_indices",)
    return "\n".join(
        [
            "ply",
            f"format {form} 1.0",
            *more,
            f"element vertex {vertices}",
            *(f"property {p}" for p in vertex),
            f"element face {faces}",
            *(f"property {p}" for p in face),
            "end_header\n",
        ]
    ).encode()


def ply(vertices=CUBE, polygons=SQUARES, counts=None, **header):
    """ASCII; `counts` may declare something else than what follows."""
    declared = counts or (len(vertices), len(polygons))
    return ply_header(*declared, **header) + (lines(vertices) + lines(counted(polygons))).encode()


def binary_ply(vertices=CUBE, polygons=SQUARES, counts=None, order="<", **header):
    declared = counts or (len(vertices), len(polygons))
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    body = np.asarray(vertices, dtype=order + "f4").tobytes()
    body += b"".join(struct.pack(f"{order}B{len(row)}i", len(row), *row) for row in polygons)
    return ply_header(*declared, form=form, **header) + body


def glb_bytes(tree, binary=b""):
    """A GLB of any JSON at all."""
    text = json.dumps(tree).encode() if isinstance(tree, dict | list) else tree
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text
    if binary:
        binary += bytes(-len(binary) % 4)
        chunks += struct.pack("<I", len(binary)) + b"BIN\0" + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def gltf(positions=None, indices=None, **changes):
    """The JSON and the buffer of one mesh in one node, with sections of the JSON replaced by `changes`."""
    positions = np.asarray(CUBE if positions is None else positions, dtype="<f4")
    indices = np.asarray(TRIANGLES if indices is None else indices, dtype="<u2").ravel()
    binary = positions.tobytes() + indices.tobytes()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(positions)},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": len(indices)},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": positions.nbytes},
            {"buffer": 0, "byteOffset": positions.nbytes, "byteLength": indices.nbytes},
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    return {**tree, **changes}, binary


def glb(positions=None, indices=None, **changes):
    return glb_bytes(*gltf(positions, indices, **changes))
