"""The check of PLY, text and binary: the declarations of the header against the content."""

from collections import deque
from itertools import islice

import numpy as np

from core.arrays import Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Limits, Plain, declared
from core.io.ply_binary import end_of_rows, read_lists
from core.io.ply_header import Element, Header, Property, read_header
from core.io.polygons import triangles
from core.io.text import counted_polygons, face_lines, plain_text, rows, take


def check(data: bytes, limits: Limits) -> Plain:
    """Check a PLY and return its vertices, unchanged, and its faces as triangles, with a minimal header.

    Raises
    ------
    MeshError
        The file is malformed or exceeds the limits; the subclass tells the kind of fault.
    """
    header = read_header(data)
    vertex, face = header.element("vertex"), header.element("face")
    if vertex is None or not {"x", "y", "z"} <= {p.name for p in vertex.properties}:
        raise MalformedMeshError("the PLY declares no vertices with x, y and z")
    if any(p.length for p in vertex.properties):
        raise MalformedMeshError("the PLY has lists in its vertices, which are not read")
    if face is None or face.count == 0:
        raise NoTrianglesError("the PLY has no faces")
    index = face.property("vertex_indices", "vertex_index")
    if index is None or not index.length or index.value.startswith("f"):
        raise MalformedMeshError("the faces of the PLY have no list of whole numbers called vertex_indices")
    declared(vertex.count, len(data), limits.vertices, "vertices")
    with_lists = [element.count for element in header.elements if any(p.length for p in element.properties)]
    declared(sum(with_lists), len(data), limits.faces, "faces and other rows with lists")
    read = _read_text if header.encoding == "ascii" else _read_binary
    positions, corners, sizes = read(data, header, vertex, face, index)
    faces = triangles(corners, sizes, vertex.count, limits)
    return Plain(_plain(header, vertex, positions, faces), "ply", vertex.count, len(faces))


def _read_text(
    data: bytes, header: Header, vertex: Element, face: Element, index: Property
) -> tuple[bytes, Ints, Ints]:
    """Return the rows of the vertices, and the corners and sizes of the polygons."""
    lines = rows(plain_text(data[header.end :]))
    positions: list[bytes] = []
    polygons: list[bytes] = []
    for element in header.elements:
        if element is vertex:
            positions = take(lines, vertex.count, "vertices")
        elif element is face:
            polygons = take(lines, face.count, "faces")
        else:
            deque(islice(lines, element.count), maxlen=0)
    if next(lines, None) is not None:
        raise MalformedMeshError("the PLY goes on after the last row that it declares")
    if any(len(line.split()) != len(vertex.properties) for line in positions):
        raise MalformedMeshError("a vertex of the PLY has more or fewer numbers than are declared")
    before = [bool(p.length) for p in face.properties[: face.properties.index(index)]]
    return b"".join(positions), *counted_polygons(polygons, before)


def _read_binary(
    data: bytes, header: Header, vertex: Element, face: Element, index: Property
) -> tuple[bytes, Ints, Ints]:
    """Return the rows of the vertices, and the corners and sizes of the polygons."""
    positions = b""
    corners = sizes = np.zeros(0, dtype=np.int64)
    end = header.end
    for element in header.elements:
        start = end
        if element is face:
            corners, sizes, end = read_lists(data, start, element, header.byte_order, index)
        elif any(p.length for p in element.properties):
            *_, end = read_lists(data, start, element, header.byte_order, None)
        else:
            end = end_of_rows(data, start, element)
        if element is vertex:
            positions = data[start:end]
    if data[end:].strip():
        raise MalformedMeshError("the PLY goes on after the last row that it declares")
    return positions, corners, sizes


def _plain(header: Header, vertex: Element, positions: bytes, faces: Ints) -> bytes:
    """Write a PLY of vertices and triangles.

    Only the coordinates keep their names: a reader would take other properties for colours or split vertices.
    """
    names = [p.name if p.name in {"x", "y", "z"} else f"unused{i}" for i, p in enumerate(vertex.properties)]
    lines = [
        "ply",
        f"format {header.encoding} 1.0",
        f"element vertex {vertex.count}",
        *(f"property {p.declared} {name}" for p, name in zip(vertex.properties, names, strict=True)),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    if header.encoding == "ascii":
        polygons = face_lines(faces, "3 %d %d %d\n")
    else:
        table = np.empty(len(faces), dtype=[("size", "u1"), ("corners", header.byte_order + "i4", (3,))])
        table["size"], table["corners"] = 3, faces
        polygons = table.tobytes()
    return "\n".join(lines).encode() + positions + polygons
