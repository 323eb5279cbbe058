"""Reading STL, binary and ASCII: triangles without indices; writing binary STL."""

import re
from collections.abc import Iterator

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Limits, within
from core.io.text import coordinates, plain_text
from core.io.trimesh_export import export
from core.mesh.mesh import Mesh

_HEADER_BYTES = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
# The name of a solid may hold any word, so it is cut away with the keyword; its line ends it, or a facet.
_SOLID = re.compile(rb"solid\b[^\n]*?(?=\bfacet\s+normal\b|\n)")
_NUMBERS = rb"(?:\s++\S++){3}"
_ASCII_FACET = re.compile(
    rb"facet\s++normal%(n)b\s++outer\s++loop(?:\s++vertex%(n)b){3}\s++endloop\s++endfacet" % {b"n": _NUMBERS}
)
_VERTEX = re.compile(rb"\bvertex(%b)" % _NUMBERS)
_BLOCK_BYTES = 1 << 20


def read(data: bytes, limits: Limits) -> tuple[Floats, Ints]:
    """Return the corners of the triangles of an STL, shape (3 f, 3), and its faces, shape (f, 3).

    A file is binary if its length agrees with its count. The first word cannot decide: the header of a binary
    file may begin with "solid".
    """
    facets = int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    expected = _HEADER_BYTES + _FACET.itemsize * facets
    if len(data) == expected:
        within(facets, limits.faces, "triangles")
        table = np.frombuffer(data, _FACET, facets, _HEADER_BYTES)
        return _separate(table["corners"].astype(np.float64))
    if data[:512].lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid" and b"\0" not in data:
        return _ascii(plain_text(data).lower(), limits)
    if len(data) < _HEADER_BYTES:
        raise MalformedMeshError("the file is neither an ASCII STL nor long enough for a binary one")
    raise MalformedMeshError(
        f"the STL declares {facets} triangles, which take {expected} bytes, but has {len(data)} bytes"
    )


def write(mesh: Mesh) -> bytes:
    """Return a mesh as a binary STL, in 32 bits; each face has its own three vertices."""
    return export(mesh, "stl")


def _separate(corners: Floats) -> tuple[Floats, Ints]:
    """Return the vertices and faces of triangles, shape (f, 3, 3), that share no vertex."""
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _ascii(text: bytes, limits: Limits) -> tuple[Floats, Ints]:
    """Read an ASCII file in lower case."""
    within(text.count(b"endsolid"), limits.parts, "solids")
    corners: list[Floats] = []
    count = 0
    for block in _blocks(text.replace(b"end solid", b"endsolid")):
        rest, facets = _ASCII_FACET.subn(b"", block)
        if rest.strip():
            raise MalformedMeshError("a facet of the STL is not a triangle, or is not complete")
        count += facets
        within(count, limits.faces, "triangles")
        # One line for each vertex, wherever the lines of the file end.
        lines = [b" ".join(numbers.split()) for numbers in _VERTEX.findall(block)]
        corners.append(coordinates(lines))
    if count == 0:
        raise NoTrianglesError("the STL has no facets")
    return _separate(np.concatenate(corners).reshape(-1, 3, 3))


def _blocks(text: bytes) -> Iterator[bytes]:
    """Yield the facets of the solids in blocks of about a megabyte."""
    start, opened = 0, False
    for match in _SOLID.finditer(text):
        closes = text[max(match.start() - 3, 0) : match.start()] == b"end"
        if opened != closes:
            raise MalformedMeshError("a solid of the STL begins or ends inside another")
        if closes:
            yield from _cut(text, start, match.start() - 3)
        else:
            _refuse(text[start : match.start()])
        start, opened = match.end(), not closes
    if opened:
        raise MalformedMeshError("the last solid of the STL has no end: the file is cut short")
    _refuse(text[start:])


def _cut(text: bytes, start: int, stop: int) -> Iterator[bytes]:
    """Yield the facets of one solid in blocks."""
    while start < stop:
        cut = text.find(b"endfacet", start + _BLOCK_BYTES, stop)
        end = stop if cut < 0 else cut + len(b"endfacet")
        yield text[start:end]
        start = end


def _refuse(outside: bytes) -> None:
    """Raise if there is text outside the solids."""
    if outside.strip():
        raise MalformedMeshError("the STL goes on outside its solids")
