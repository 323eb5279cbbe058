"""GLB files for viewers: small upright meshes with vertex colours."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.io import FORMATS
from service.rendering.thumbnail import frame, upright

MEDIA_TYPE = FORMATS["glb"].media_type

SPACING = 2.4
"""Distance of the centres of neighbouring meshes, each of which extends from -1 to 1."""

_BYTE, _FLOAT, _UNSIGNED_INT = 5121, 5126, 5125


@dataclass(frozen=True, eq=False)
class GlbPart:
    """One mesh of a GLB file.

    Attributes
    ----------
    name : str
    format : str
        Format of the mesh's file, which determines the upward axis.
    vertices : float64, shape (n, 3)
    faces : int64, shape (f, 3)
    facts : dict
        Additional `extras` of the node.
    colours : uint8, shape (n, 4) or (0, 4)
        Vertex colours (red, green, blue, opacity), if any.
    """

    name: str
    format: str
    vertices: Floats
    faces: Ints
    facts: dict[str, Any] = field(default_factory=dict)
    colours: NDArray[np.uint8] = field(default_factory=lambda: np.empty((0, 4), np.uint8))


def write_glb(parts: list[GlbPart]) -> bytes:
    """Return a GLB of meshes side by side, each scaled to the same size, with y up.

    Positions are 32-bit floats in [-1, 1]. The matrix of a node places its mesh. Its `extras` have `middle`
    and `half`: a point p of the original file is stored as (p - middle) / half.
    """
    binary: list[bytes] = []
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    nodes: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []

    def add(array: NDArray[Any], component: int, kind: str, **more: Any) -> int:  # noqa: ANN401
        start = sum(map(len, binary))
        binary.append(array.tobytes())
        views.append({"buffer": 0, "byteOffset": start, "byteLength": array.nbytes})
        accessor = {"bufferView": len(views) - 1, "componentType": component, "type": kind}
        accessors.append({**accessor, "count": array.size if kind == "SCALAR" else len(array), **more})
        return len(accessors) - 1

    for number, part in enumerate(parts):
        middle, half = frame(part.vertices)
        points = ((part.vertices - middle) / half).astype("<f4")
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        attributes = {"POSITION": add(points, _FLOAT, "VEC3", **bounds)}
        if len(part.colours):
            attributes["COLOR_0"] = add(part.colours, _BYTE, "VEC4", normalized=True)
        indices = add(part.faces.astype("<u4").ravel(), _UNSIGNED_INT, "SCALAR")
        matrix = np.eye(4)
        matrix[:3, :3] = upright(part.format)
        matrix[0, 3] = SPACING * (number - 0.5 * (len(parts) - 1))
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices}]})
        nodes.append(
            {
                "name": part.name,
                "mesh": number,
                "matrix": matrix.ravel(order="F").tolist(),
                "extras": {**part.facts, "middle": middle.tolist(), "half": half},
            }
        )
    tree = {
        "asset": {"version": "2.0", "generator": "Isoshape"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "buffers": [{"byteLength": sum(map(len, binary))}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(tree, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = _chunk(b"JSON", text) + _chunk(b"BIN\0", b"".join(binary))
    return b"glTF" + _number(2) + _number(12 + len(chunks)) + chunks


def _chunk(kind: bytes, data: bytes) -> bytes:
    return _number(len(data)) + kind + data


def _number(value: int) -> bytes:
    return value.to_bytes(4, "little")
