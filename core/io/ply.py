"""Reading PLY, text and binary, in three steps: the header, then rows of text or of bytes; writing PLY."""

import re
import struct
from array import array
from collections import deque
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Content, Limits, declared
from core.io.polygons import triangles
from core.io.text import coordinates, counted_polygons, plain_text, rows, take, without_lists, without_mark
from core.io.trimesh_export import export
from core.mesh.mesh import Mesh

_START = re.compile(rb"ply[ \t]*(\r\n|\n|\r)", re.IGNORECASE)
_LONGEST_HEADER = 1 << 20
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
    **{"float16": "f2", "half": "f2"},
}
# Triangle strips, as Stanford's scans have them, and comments among the rows of text.
_STRIPS = "tristrips"
_COMMENTS = re.compile(rb"\n[ \t]*comment[^\n]*")
_LETTERS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q"}
_LETTERS |= {"f2": "e", "f4": "f", "f8": "d"}
# A whole number as a text of floats writes it.
_FRACTION = re.compile(rb"\.0*(?![^ \t\n])")


@dataclass(frozen=True)
class Property:
    """One value, or a list of values, in every row of an element.

    `value` and `length` are NumPy's codes, without byte order, of the values and of a list's length, which is
    empty for a single value.
    """

    name: str
    value: str
    length: str


@dataclass(frozen=True)
class Element:
    """A table: `count` rows of the same properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    def property(self, *names: str) -> Property | None:
        """Return the first property that has one of the names."""
        return next((p for p in self.properties if p.name in names), None)


@dataclass(frozen=True)
class Header:
    """The declarations of a header.

    `byte_order` is NumPy's character, empty for text; `end` is the offset of the first element in bytes.
    """

    byte_order: str
    elements: tuple[Element, ...]
    end: int

    def element(self, *names: str) -> Element | None:
        """Return the first element that has one of the names, with rows if there is such."""
        named = [element for element in self.elements if element.name in names]
        return next((element for element in named if element.count), named[0] if named else None)


def read(data: bytes, limits: Limits) -> Content:
    """Return the vertices of a PLY, and its faces or strips of triangles as triangles."""
    data = without_mark(data)
    header = _read_header(data)
    vertex, face = header.element("vertex"), header.element("face", "polygon", _STRIPS)
    if vertex is None or not {"x", "y", "z"} <= {p.name for p in vertex.properties if not p.length}:
        raise MalformedMeshError("the PLY declares no vertices with x, y and z")
    if face is None or face.count == 0:
        raise NoTrianglesError("the PLY has no faces")
    index = face.property("vertex_indices", "vertex_index", "vertex_indexes")
    if index is None or not index.length:
        raise MalformedMeshError("the faces of the PLY have no list called vertex_indices")
    declared(vertex.count, len(data), limits.vertices, "vertices")
    with_lists = [element.count for element in header.elements if any(p.length for p in element.properties)]
    declared(sum(with_lists), len(data), limits.faces, "faces and other rows with lists")
    rows_of = _read_binary if header.byte_order else _read_text
    positions, corners, sizes, rest = rows_of(data, header, vertex, face, index)
    if face.name == _STRIPS:
        corners = _of_strips(corners, sizes)
        sizes = np.full(len(corners) // 3, 3)
    warnings = ("the PLY goes on after the last row that it declares; the rest is left out",) if rest else ()
    return Content(positions, triangles(corners, sizes, positions, limits), warnings)


def write(mesh: Mesh) -> bytes:
    """Return a mesh as a binary PLY, little-endian, in 32 bits."""
    return export(mesh, "ply")


def _read_header(data: bytes) -> Header:
    """Read the header of a PLY; raise MalformedMeshError if it is not a valid one."""
    start = _START.match(data)
    if start is None:
        raise MalformedMeshError("the file does not begin with a line that says ply")
    newline = start.group(1)
    # Some writers end only this line with two characters.
    last = newline if newline == b"\r" else b"\r?\n"
    end = re.compile(newline + rb"end_header[ \t]*" + last).search(data, 0, _LONGEST_HEADER)
    if end is None:
        raise MalformedMeshError("the header of the PLY has no end")
    lines = [
        line.split() for line in data[start.end() : end.start()].decode("latin-1").split(newline.decode())
    ]
    byte_order = None
    elements: list[tuple[str, int, list[Property]]] = []
    for words in lines:
        match words:
            case ["format", form, _] if form in _BYTE_ORDERS:
                byte_order = _BYTE_ORDERS[form]
            case ["element", name, count] if count.isdecimal():
                elements.append((name, int(count), []))
            case ["property", *rest] if elements:
                elements[-1][2].append(_property(rest))
            case ["format" | "element" | "property", *_]:
                raise MalformedMeshError("a line in the header of the PLY makes no sense")
            case _:
                # A comment, with or without the word.
                pass
    if byte_order is None:
        raise MalformedMeshError("the header of the PLY does not say whether it is text or binary")
    for names in [
        [name for name, _, _ in elements],
        *([p.name for p in properties] for _, _, properties in elements),
    ]:
        if len(set(names)) < len(names):
            raise MalformedMeshError("the header of the PLY declares a name twice")
    for _, _, properties in elements:
        # Capitals do not matter, unless they tell two names apart.
        if len({p.name.lower() for p in properties}) == len(properties):
            properties[:] = [replace(p, name=p.name.lower()) for p in properties]
    return Header(
        byte_order, tuple(Element(name, n, tuple(properties)) for name, n, properties in elements), end.end()
    )


def _property(words: list[str]) -> Property:
    """Parse the words after the keyword `property`."""
    match words:
        case ["list", length, value, name] if length in _TYPES and value in _TYPES:
            return Property(name, _TYPES[value], _TYPES[length])
        case [value, name] if value in _TYPES:
            return Property(name, _TYPES[value], "")
    raise MalformedMeshError("a property in the header of the PLY has a type that is not known")


def _of_strips(corners: Ints, sizes: Ints) -> Ints:
    """Return the corners of the triangles, shape (3 f,), of strips that end with their list or with -1."""
    ends = np.zeros(len(corners) + 1, dtype=bool)
    ends[np.cumsum(sizes)] = True
    breaks = (corners < 0) | ends[1:]
    # The position of each corner in its strip.
    after = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    places = (
        np.arange(len(corners)) - after[np.searchsorted(after, np.arange(len(corners)), side="right") - 1]
    )
    inside = np.flatnonzero((places >= 2) & (corners >= 0))
    strips = np.stack([corners[inside - 2], corners[inside - 1], corners[inside]], axis=1)
    # Every second triangle of a strip has the opposite orientation.
    odd = places[inside] % 2 == 1
    strips[odd] = strips[odd][:, [1, 0, 2]]
    return strips.ravel()


def _read_text(
    data: bytes, header: Header, vertex: Element, face: Element, index: Property
) -> tuple[Floats, Ints, Ints, bool]:
    """Return positions, the corners and the sizes of polygons, and whether the file goes on after them."""
    text = plain_text(data[header.end :])
    lines = rows(_COMMENTS.sub(b"\n", b"\n" + text) if b"comment" in text else text)
    positions: list[bytes] = []
    polygons: list[bytes] = []
    for element in header.elements:
        if element is vertex:
            positions = take(lines, vertex.count, "vertices")
        elif element is face:
            polygons = take(lines, face.count, "faces")
        else:
            deque(islice(lines, element.count), maxlen=0)
    rest = next(lines, None) is not None
    single = [p for p in vertex.properties if not p.length]
    if len(single) < len(vertex.properties):
        is_list = [bool(p.length) for p in vertex.properties]
        positions = [b" ".join(without_lists(line.split(), is_list)) for line in positions]
    if any(len(line.split()) != len(single) for line in positions):
        raise MalformedMeshError("a vertex of the PLY has more or fewer numbers than are declared")
    before = [bool(p.length) for p in face.properties[: face.properties.index(index)]]
    if "f" in {p.length[:1] for p in face.properties} | {index.value[0]}:
        polygons = [_FRACTION.sub(b"", line) for line in polygons]
    table = coordinates(positions, range(len(single)))
    columns = {p.name: (column, p.value) for p, column in zip(single, table.T, strict=True)}
    # With the precision of their type, as in a binary file.
    converted = np.column_stack([_converted(*columns[axis]) for axis in "xyz"])
    return converted, *counted_polygons(polygons, before), rest


def _converted(column: Floats, type: str) -> Floats:
    """Convert the coordinates of one axis to the declared type, and back."""
    if type[0] in "iu":
        bounds = np.iinfo(type)
        if not ((column >= bounds.min) & (column <= bounds.max)).all():
            raise MalformedMeshError("a coordinate of the PLY does not fit its declared type")
    return column.astype(type).astype(np.float64)


def _read_binary(
    data: bytes, header: Header, vertex: Element, face: Element, index: Property
) -> tuple[Floats, Ints, Ints, bool]:
    """Return positions, the corners and the sizes of polygons, and whether the file goes on after them."""
    positions = np.empty((0, 3))
    corners = sizes = np.zeros(0, dtype=np.int64)
    end = header.end
    for element in header.elements:
        axes = [p for p in element.properties if p.name in {"x", "y", "z"}] if element is vertex else []
        table = _equal_rows(data, end, element, header.byte_order)
        if table is None:
            wanted = [index] if element is face else axes
            values, counts, end = _walk(data, end, element, header.byte_order, wanted)
            if element is vertex:
                order = ["xyz".index(p.name) for p in axes]
                positions = values.astype(np.float64).reshape(-1, 3)[:, np.argsort(order)]
            elif element is face:
                corners, sizes = _whole(values), counts
            continue
        end += table.nbytes
        if element is vertex:
            positions = np.column_stack([table[axis].astype(np.float64) for axis in "xyz"])
        elif element is face:
            rectangle = _whole(table[index.name])
            corners, sizes = rectangle.ravel(), np.full(len(table), rectangle.shape[1], dtype=np.int64)
    return positions, corners, sizes, bool(data[end:].strip(b" \t\r\n\0"))


def _whole(indices: NDArray[np.generic]) -> Ints:
    """Return indices of any type as integers; raise MalformedMeshError if one is not whole."""
    if indices.dtype.kind == "f" and not ((indices == np.trunc(indices)) & (np.abs(indices) < 2.0**53)).all():
        raise MalformedMeshError("a face has an index that is not a whole number")
    return indices.astype(np.int64)


def _equal_rows(
    data: bytes, start: int, element: Element, order: str
) -> np.ndarray[tuple[int], np.dtype[np.void]] | None:
    """Return the rows of an element as a table; None for rows of several lists or of unequal lengths.

    Raise MalformedMeshError if the element extends beyond the end of the data.
    """
    lists = [p for p in element.properties if p.length]
    if len(lists) > 1:
        return None
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    length = at = 0
    for p in element.properties:
        if p.length and element.count:
            # The first row tells the length of the list.
            if start + at + np.dtype(p.length).itemsize > len(data):
                raise _cut_short(element)
            length = int(np.frombuffer(data, order + p.length, 1, start + at)[0])
        if not 0 <= length <= len(data):
            return None
        at += _size(p)
        if p.length:
            fields += [("length of " + p.name, order + p.length), (p.name, order + p.value, (length,))]
        else:
            fields.append((p.name, order + p.value))
    row = np.dtype(fields)
    if row.itemsize * element.count > len(data) - start:
        if lists:
            return None
        raise _cut_short(element)
    table = np.ndarray((element.count,), row, data, start)
    return table if all((table["length of " + p.name] == length).all() for p in lists) else None


def _walk(
    data: bytes, start: int, element: Element, order: str, wanted: list[Property]
) -> tuple[NDArray[np.generic], Ints, int]:
    """Read row by row: the values of the wanted properties, their numbers, and the end of the element."""
    steps = [
        (
            struct.Struct(order + _LETTERS[p.length]) if p.length else None,
            _size(p),
            _LETTERS[p.value] if p in wanted else "",
        )
        for p in element.properties
    ]
    values = array("d" if any(p.value[0] == "f" for p in wanted) else "q")
    sizes = array("q")
    position = start
    try:
        for _ in range(element.count):
            for length, size, letter in steps:
                number = 1
                if length:
                    number = int(length.unpack_from(data, position)[0])
                    position += length.size
                    if number < 0:
                        raise MalformedMeshError("a list of the PLY has a negative length")
                if letter:
                    values.extend(struct.unpack_from(f"{order}{number}{letter}", data, position))
                    sizes.append(number)
                position += number * size
    except (struct.error, OverflowError):
        raise _cut_short(element) from None
    if position > len(data):
        raise _cut_short(element)
    return np.array(values), np.array(sizes, dtype=np.int64), position


def _size(p: Property) -> int:
    """Return the bytes of one value."""
    return np.dtype(p.value).itemsize


def _cut_short(element: Element) -> MalformedMeshError:
    return MalformedMeshError(
        f"the PLY declares {element.count} rows of {element.name} and ends before the last"
    )
