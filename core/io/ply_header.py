"""The header of a PLY: elements, their numbers of rows and their properties."""

import re
from dataclasses import dataclass

from core.errors import MalformedMeshError

_START = re.compile(rb"ply[ \t]*(\r\n|\n|\r)", re.IGNORECASE)
_LONGEST_HEADER = 1 << 20
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}


@dataclass(frozen=True)
class Property:
    """One value, or a list of values, in every row of an element.

    Attributes
    ----------
    name : str
    value : str
        Type of the value as NumPy's code, without byte order.
    length : str
        Type of the length of a list as NumPy's code; empty for a single value.
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
        return next((found for found in self.properties if found.name in names), None)


@dataclass(frozen=True)
class Header:
    """The declarations of a header.

    Attributes
    ----------
    encoding : str
        "ascii", "binary_little_endian" or "binary_big_endian".
    elements : tuple of Element
        Elements in the order of the file.
    end : int
        Offset of the first element, in bytes.
    """

    encoding: str
    elements: tuple[Element, ...]
    end: int

    @property
    def byte_order(self) -> str:
        """NumPy's character for the byte order; empty for text."""
        return _BYTE_ORDERS[self.encoding]

    def element(self, name: str) -> Element | None:
        """Return the element of that name."""
        return next((found for found in self.elements if found.name == name), None)


def read_header(data: bytes) -> Header:
    """Read the header of a PLY.

    Raises
    ------
    MalformedMeshError
        The data have no valid header.
    """
    start = _START.match(data)
    if start is None:
        raise MalformedMeshError("the file does not begin with a line that says ply")
    newline = start.group(1)
    end = re.compile(newline + rb"end_header[ \t]*" + newline).search(data, 0, _LONGEST_HEADER)
    if end is None:
        raise MalformedMeshError("the header of the PLY has no end")
    lines = [
        line.split() for line in data[start.end() : end.start()].decode("latin-1").split(newline.decode())
    ]
    encoding = ""
    elements: list[tuple[str, int, list[Property]]] = []
    for words in lines:
        match words:
            case ["format", form, _] if form in _BYTE_ORDERS:
                encoding = form
            case ["element", name, count] if count.isdecimal():
                elements.append((name, int(count), []))
            case ["property", *rest] if elements:
                elements[-1][2].append(_property(rest))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise MalformedMeshError("a line in the header of the PLY makes no sense")
    if not encoding:
        raise MalformedMeshError("the header of the PLY does not say whether it is text or binary")
    for names in [[name for name, _, _ in elements], *([p.name for p in own] for _, _, own in elements)]:
        if len(set(names)) < len(names):
            raise MalformedMeshError("the header of the PLY declares a name twice")
    return Header(encoding, tuple(Element(name, n, tuple(own)) for name, n, own in elements), end.end())


def _property(words: list[str]) -> Property:
    """Parse the words after the keyword `property`."""
    match words:
        case ["list", length, value, name] if (
            length in _TYPES and value in _TYPES and _TYPES[length][0] != "f"
        ):
            return Property(name, _TYPES[value], _TYPES[length])
        case [value, name] if value in _TYPES:
            return Property(name, _TYPES[value], "")
    raise MalformedMeshError("a property in the header of the PLY has a type that is not known")
