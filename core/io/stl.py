"""Reading STL, binary and ASCII: triangles without indices; writing binary STL."""

import re
from collections.abc import Iterator

import numpy as np

from core.arrays import Floats
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Content, Limits, within
from core.io.polygons import triangles
from core.io.text import coordinates, plain_text, without_mark
from core.io.trimesh_export import export
from core.mesh.mesh import Mesh

_HEADER_BYTES = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
# The name of a solid may hold any word, so it is cut away with the keyword; its line ends it, or a facet.
_SOLID = re.compile(rb"solid\b[^\n]*?(?=\bfacet\s+(?:normal|outer)\b|\n)")
# Three words that are none of the format's: a search that fails does so at the next of these.
_NUMBERS = rb"(?:\s++(?!facet|outer|vertex|end)\S++){3}"
_ASCII_FACET = re.compile(
    rb"facet(?:\s++normal%(n)b)?+\s++outer\s++loop((?:\s++vertex%(n)b){3,}+)\s++end\s*+loop\s++end\s*+facet"
    % {b"n": _NUMBERS}
)
# A number sign inside a number, as in -1.#IND, begins no comment.
_COMMENT = re.compile(rb"(?<![^\s])#[^\n]*")
_VERTEX = re.compile(rb"\bvertex(%b)" % _NUMBERS)
_BLOCK_BYTES = 1 << 20
# A word between two solids, which no facet goes on over.
_BETWEEN = b" solid "


def read(data: bytes, limits: Limits) -> Content:
    """Return the corners of the triangles of an STL as vertices, and its faces.

    A file is binary if its length agrees with its count. The first word cannot decide: the header of a binary
    file may begin with "solid".
    """
    declared = _declared(data)
    if is_binary(data):
        return _binary(data, declared, limits)
    text = without_mark(data)
    if b"\0" not in text.rstrip(b"\0"):
        text = plain_text(text).lower()
        if b"#" in text:
            text = _COMMENT.sub(b"", text)
        if text.lstrip().startswith(b"solid"):
            return _ascii(text, limits)
        raise MalformedMeshError("the file is text that does not begin as an STL does, with the word solid")
    return _of_another_length(data, declared, limits)


def write(mesh: Mesh) -> bytes:
    """Return a mesh as a binary STL, in 32 bits; each face has its own three vertices."""
    return export(mesh, "stl")


def _of_another_length(data: bytes, declared: int, limits: Limits) -> Content:
    """Read a binary file that is longer or shorter than its count says: the triangles that are whole."""
    whole, rest = divmod(len(data) - _HEADER_BYTES, _FACET.itemsize)
    if len(data) < _HEADER_BYTES + _FACET.itemsize - 2:
        raise MalformedMeshError("the file is neither an ASCII STL nor long enough for a binary one")
    if rest == _FACET.itemsize - 2:
        # The last attribute is missing, which is not read.
        data, whole, rest = data + b"\0\0", whole + 1, 0
    if rest and declared > whole + 1:
        raise MalformedMeshError(
            f"the STL declares {declared} triangles but holds {whole} and a part of one: it is cut short"
        )
    facets = declared if rest and 0 < declared < whole else whole
    warning = f"the STL declares {declared} triangles and has bytes for {whole}; {facets} are read"
    if declared == whole:
        warning = "the STL goes on after its last triangle; the rest is left out"
    return _binary(data, facets, limits, *([warning] if rest or facets != declared else []))


def is_binary(data: bytes) -> bool:
    """Return whether the length of a file is that of a binary STL with its count."""
    return len(data) == _HEADER_BYTES + _FACET.itemsize * _declared(data)


def _declared(data: bytes) -> int:
    """Return the count of triangles in the header of a binary STL."""
    return int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")


def _binary(data: bytes, facets: int, limits: Limits, *warnings: str) -> Content:
    """Return the first facets of a binary STL."""
    within(facets, limits.faces, "triangles")
    corners = np.frombuffer(data, _FACET, facets, _HEADER_BYTES)["corners"].astype(np.float64)
    return Content(corners.reshape(-1, 3), np.arange(3 * facets).reshape(-1, 3), warnings)


def _ascii(text: bytes, limits: Limits) -> Content:
    """Read an ASCII file in lower case."""
    corners: list[Floats] = []
    sizes: list[int] = []
    warnings: list[str] = []
    for block in _gathered(_blocks(text.replace(b"end solid", b"endsolid"), warnings)):
        # The outside of the facets, and their loops in turn.
        pieces = _ASCII_FACET.split(block)
        if any(outside.replace(_BETWEEN, b"").strip() for outside in pieces[::2]):
            raise MalformedMeshError("a facet of the STL is not a polygon, or is not complete")
        sizes += [loop.count(b"vertex") for loop in pieces[1::2]]
        within(len(sizes), limits.faces, "triangles")
        # One line for each vertex, wherever the lines of the file end.
        lines = [b" ".join(numbers.split()) for numbers in _VERTEX.findall(block)]
        corners.append(coordinates(lines))
    if not sizes:
        raise NoTrianglesError("the STL has no facets")
    vertices = np.concatenate(corners)
    faces = triangles(np.arange(len(vertices)), np.array(sizes), vertices, limits)
    return Content(vertices, faces, tuple(warnings))


def _blocks(text: bytes, warnings: list[str]) -> Iterator[bytes]:
    """Yield the facets of the solids in blocks of at most about a megabyte, and add to the warnings."""
    start, opened = 0, False
    for match in _SOLID.finditer(text):
        closes = text[max(match.start() - 3, 0) : match.start()] == b"end"
        if opened != closes:
            raise MalformedMeshError("a solid of the STL begins or ends inside another")
        if closes:
            yield from _cut(text, start, match.start() - 3)
        elif text[start : match.start()].strip():
            raise MalformedMeshError("the STL goes on outside its solids")
        start, opened = match.end(), not closes
    if opened:
        warnings.append("the last solid of the STL has no end: the file may be cut short")
        yield from _cut(text, start, len(text))
    elif b"facet" in text[start:]:
        raise MalformedMeshError("the STL goes on outside its solids")
    elif text[start:].strip():
        warnings.append("the STL goes on after its last solid; the rest is left out")


def _gathered(blocks: Iterator[bytes]) -> Iterator[bytes]:
    """Yield the blocks of small solids together: each parse has a cost of its own."""
    waiting: list[bytes] = []
    size = 0
    for block in blocks:
        waiting.append(block)
        size += len(block)
        if size >= _BLOCK_BYTES:
            yield _BETWEEN.join(waiting)
            waiting, size = [], 0
    yield _BETWEEN.join(waiting)


def _cut(text: bytes, start: int, stop: int) -> Iterator[bytes]:
    """Yield the facets of one solid in blocks."""
    while start < stop:
        cut = text.find(b"endfacet", start + _BLOCK_BYTES, stop)
        end = stop if cut < 0 else cut + len(b"endfacet")
        yield text[start:end]
        start = end
