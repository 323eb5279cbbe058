"""Reading PLY, text and binary."""

from collections import deque
from itertools import islice

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Limits, declared
from core.io.ply_binary import end_of_rows, read_lists
from core.io.ply_header import Element, Header, Property, read_header
from core.io.polygons import triangles
from core.io.text import coordinates, counted_polygons, plain_text, rows, take


def read(data: bytes, limits: Limits) -> tuple[Floats, Ints]:
    """Return the vertices of a PLY, shape (n, 3), and its faces as triangles, shape (f, 3).

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
    rows_of = _read_text if header.encoding == "ascii" else _read_binary
    positions, corners, sizes = rows_of(data, header, vertex, face, index)
    return positions, triangles(corners, sizes, vertex.count, limits)


def _read_text(
    data: bytes, header: Header, vertex: Element, face: Element, index: Property
) -> tuple[Floats, Ints, Ints]:
    """Return the positions of the vertices, and the corners and sizes of the polygons."""
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
    table = coordinates(positions, range(len(vertex.properties)))
    columns = {p.name: (column, p.value) for p, column in zip(vertex.properties, table.T, strict=True)}
    # With the precision of their type, as in a binary file.
    converted = np.column_stack([_converted(*columns[axis]) for axis in "xyz"])
    return converted, *counted_polygons(polygons, before)


def _converted(column: Floats, type: str) -> Floats:
    """Convert the coordinates of one axis to the declared type, and back."""
    if type[0] in "iu":
        bounds = np.iinfo(type)
        if not ((column >= bounds.min) & (column <= bounds.max)).all():
            raise MalformedMeshError("a coordinate of the PLY does not fit its declared type")
    return column.astype(type).astype(np.float64)


def _read_binary(
    data: bytes, header: Header, vertex: Element, face: Element, index: Property
) -> tuple[Floats, Ints, Ints]:
    """Return the positions of the vertices, and the corners and sizes of the polygons."""
    positions = np.empty((0, 3))
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
            row = np.dtype([(p.name, header.byte_order + p.value) for p in element.properties])
            table = np.frombuffer(data, row, element.count, start)
            positions = np.column_stack([table[axis].astype(np.float64) for axis in "xyz"])
    if data[end:].strip():
        raise MalformedMeshError("the PLY goes on after the last row that it declares")
    return positions, corners, sizes
