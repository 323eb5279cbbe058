"""Writing a GLB of instances and triangles only."""

import json

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.io.gltf_document import Entry
from core.io.gltf_scene import Instance

_FLOAT, _UNSIGNED_INT = 5126, 5125


def plain_glb(instances: list[Instance], meshes: dict[int, tuple[Floats, Ints]]) -> bytes:
    """Write a GLB.

    Parameters
    ----------
    instances : list of Instance
        An instance of a mesh that is not in `meshes` is left out.
    meshes : dict of int to (vertices, faces)
        Vertices float64, shape (n, 3), written in 32 bits; faces int64, shape (f, 3).
    """
    arrays = [array for mesh in meshes.values() for array in mesh]
    places = {number: place for place, number in enumerate(meshes)}
    binary: list[bytes] = []
    views: list[Entry] = []
    accessors: list[Entry] = []
    start = 0
    for number, array in enumerate(arrays):
        data, component, kind = _encode(array)
        binary.append(data.tobytes())
        views.append({"buffer": 0, "byteOffset": start, "byteLength": data.nbytes})
        accessors.append({"bufferView": number, "componentType": component, "type": kind, "count": len(data)})
        start += data.nbytes
    nodes = [
        {"mesh": places[one.mesh], "matrix": one.matrix.ravel(order="F").tolist()}
        for one in instances
        if one.mesh in places
    ]
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 2 * place}, "indices": 2 * place + 1}]}
            for place in places.values()
        ],
        "buffers": [{"byteLength": start}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = _chunk(b"JSON", text) + _chunk(b"BIN\0", b"".join(binary))
    return b"glTF" + _number(2) + _number(12 + len(chunks)) + chunks


def _encode(array: Floats | Ints) -> tuple[NDArray[np.generic], int, str]:
    """Return an array as glTF stores it, its component type and its type."""
    if array.dtype.kind == "f":
        return array.astype("<f4"), _FLOAT, "VEC3"
    return array.astype("<u4").ravel(), _UNSIGNED_INT, "SCALAR"


def _chunk(kind: bytes, data: bytes) -> bytes:
    return _number(len(data)) + kind + data


def _number(value: int) -> bytes:
    return value.to_bytes(4, "little")
