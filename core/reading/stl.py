"""STL, binary and ASCII: triangles with no indices."""

import re
from collections.abc import Iterator

from core.errors import MalformedMeshError, NoTrianglesError
from core.reading.plain import Limits, Plain, within
from core.reading.text import plain_text

_HEADER_BYTES = 84
_FACET_BYTES = 50
# The name of a solid may hold any word, so it is cut away with the keyword; its line ends it, or a facet.
_SOLID = re.compile(rb"solid\b[^\n]*?(?=\bfacet\s+normal\b|\n)")
# A facet in words: every 21 of them, at these places.
_WORDS = (
    *((0, b"facet"), (1, b"normal"), (5, b"outer"), (6, b"loop")),
    *((7, b"vertex"), (11, b"vertex"), (15, b"vertex"), (19, b"endloop"), (20, b"endfacet")),
)
_FACET_WORDS = 21
_BLOCK_BYTES = 1 << 20


def check(data: bytes, limits: Limits) -> Plain:
    """Return a binary file as it is, or the facets of an ASCII file as one solid.

    A file is binary if its length is what its count says; the first word does not tell, for the header of a
    binary file may begin with "solid".

    Raises
    ------
    MeshError
        What is wrong.
    """
    facets = int.from_bytes(data[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    if len(data) == _HEADER_BYTES + _FACET_BYTES * facets:
        within(facets, limits.faces, "triangles")
        return Plain(data, "stl", 3 * facets, facets)
    if data[:512].lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid" and b"\0" not in data:
        return _ascii(plain_text(data).lower(), limits)
    if len(data) < _HEADER_BYTES:
        raise MalformedMeshError("the file is neither an ASCII STL nor long enough for a binary one")
    raise MalformedMeshError(
        f"the STL declares {facets} triangles, which take {_HEADER_BYTES + _FACET_BYTES * facets} bytes, "
        f"but has {len(data)} bytes"
    )


def _ascii(text: bytes, limits: Limits) -> Plain:
    """Check the words of an ASCII file in small letters."""
    within(text.count(b"endsolid"), limits.parts, "solids")
    body: list[bytes] = []
    position, opened = 0, False
    for match in _SOLID.finditer(text):
        before = text[position : match.start()].rstrip(b" \t")
        closes = before.endswith(b"end")
        if opened != closes:
            raise MalformedMeshError("a solid of the STL begins or ends inside another")
        opened = not closes
        body.append(before.removesuffix(b"end"))
        position = match.end()
    if opened:
        raise MalformedMeshError("the last solid of the STL has no end: the file is cut short")
    body.append(text[position:])
    facets = b" ".join(body)
    count = sum(_facets(block) for block in _blocks(facets))
    within(count, limits.faces, "triangles")
    if count == 0:
        raise NoTrianglesError("the STL has no facets")
    plain = facets.replace(b"normal", b"").replace(b"vertex", b"\nvertex").replace(b"endloop", b"\nendloop")
    return Plain(b"solid\n" + plain + b"\nendsolid\n", "stl", 3 * count, count)


def _blocks(text: bytes) -> Iterator[bytes]:
    """Cut the text behind a facet, about every megabyte."""
    start = 0
    while start < len(text):
        end = text.find(b"endfacet", start + _BLOCK_BYTES)
        end = len(text) if end < 0 else end + len(b"endfacet")
        yield text[start:end]
        start = end


def _facets(text: bytes) -> int:
    """Return how many facets the text holds."""
    words = text.split()
    count, rest = divmod(len(words), _FACET_WORDS)
    if rest or any(words[place::_FACET_WORDS] != [word] * count for place, word in _WORDS):
        raise MalformedMeshError("a facet of the STL is not a triangle, or is not complete")
    return count
