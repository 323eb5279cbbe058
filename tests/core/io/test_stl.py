"""STL: telling binary from ASCII, what writers vary, and what is wrong."""

import numpy as np
import pytest

from core.errors import (
    DegenerateMeshError,
    MalformedMeshError,
    MeshTooComplexError,
    NonFiniteCoordinatesError,
    NoTrianglesError,
)
from core.io import Limits, read_mesh
from tests.core.io.files import CUBE, TRIANGLES, binary_stl, faulty, stl

CORNERS = CUBE[TRIANGLES]
ASCII, BINARY = stl(CORNERS), binary_stl(CORNERS)
FACET = ASCII[ASCII.index(b"facet") : ASCII.index(b"endfacet") + 9]


COLOURED = b"".join(BINARY[84 + 50 * i : 132 + 50 * i] + b"\xff\x7f" for i in range(12))
SOUND = {
    "binary": BINARY,
    "binary with attributes of faces": BINARY[:84] + COLOURED,
    "binary that begins with solid": binary_stl(CORNERS, header=b"solid cube"),
    "binary with anything in its header": binary_stl(CORNERS, header=b"\xff\xfe\0\0"),
    "ASCII": ASCII,
    "CRLF": ASCII.replace(b"\n", b"\r\n"),
    "CR": ASCII.replace(b"\n", b"\r"),
    "one line": ASCII.replace(b"\n", b" "),
    "blank lines": ASCII.replace(b"    vertex", b"vertex ").replace(b"\n", b"\n\n\t "),
    "capitals": ASCII.upper(),
    "byte order mark": b"\xef\xbb\xbf\n  " + ASCII,
    "no last newline": ASCII.rstrip(),
    "no name": stl(CORNERS, name=""),
    "a name of keywords": stl(CORNERS, name="solid vertex 1 2 3 endfacet normal"),
    "a name not in ASCII": stl(CORNERS, name="caf\xe9"),
    "end in two words": ASCII.replace(b"endsolid cube", b"end solid"),
    "normals that are not numbers": ASCII.replace(b"normal 0 0 1", b"normal nan -nan inf"),
    "two solids": stl(CORNERS[:5]) + stl(CORNERS[5:], name="other"),
    "an empty solid first": stl([]) + ASCII,
}


@pytest.mark.parametrize("data", SOUND.values(), ids=SOUND)
def test_reads(data):
    mesh = read_mesh(data, "stl")
    assert np.array_equal(mesh.vertices[mesh.faces], CORNERS)


def test_many_blocks_of_facets():
    """More than the megabyte that is looked at in one go, so that cuts fall between facets."""
    offsets = np.arange(8000)[:, None, None]
    triangles = np.eye(3) + offsets * 0.5
    mesh = read_mesh(stl(triangles), "stl")
    assert np.array_equal(mesh.vertices[mesh.faces], triangles)


MALFORMED = {
    "count 2^32 - 1": binary_stl(CORNERS, count=2**32 - 1),
    "count one too large": binary_stl(CORNERS, count=13),
    "count one too small": binary_stl(CORNERS, count=11),
    "count 0 before facets": binary_stl(CORNERS, count=0),
    "binary cut in a facet": BINARY[:-20],
    "binary that begins with solid, cut": binary_stl(CORNERS, header=b"solid x")[:-1],
    "half a header": BINARY[:40],
    "ASCII cut in a facet": ASCII[: len(ASCII) // 2],
    "ASCII cut before its end": ASCII[: ASCII.index(b"endsolid")],
    "ASCII cut in a number": ASCII[: ASCII.rindex(b"1.0")],
    "only the word": b"solid",
    "a second solid cut": ASCII + ASCII[:-30],
    "a solid in a solid": b"solid a\n" + ASCII + b"endsolid a\n",
    "an end without a beginning": ASCII + b"endsolid\n",
    "text after the end": ASCII + b"more\n",
    "facets after the end": ASCII + FACET,
    "a number missing": ASCII.replace(b"1.0\n", b"\n", 1),
    "a number too many": ASCII.replace(b"1.0\n", b"1.0 1.0\n", 1),
    "a word for a number": ASCII.replace(b"1.0", b"one", 1),
    "a vertex missing": stl([*CORNERS, CUBE[:2]]),
    "a facet of four": stl([*CORNERS, CUBE[:4]]),
    "a facet of four beside one of two": stl([*CORNERS, CUBE[:4], CUBE[:2]]),
    "no normal": ASCII.replace(b"normal 0 0 1", b"", 1),
    "no loop": ASCII.replace(b"outer loop", b"", 1),
}
BAD = {
    MalformedMeshError: MALFORMED,
    NoTrianglesError: {"binary with no facets": binary_stl([]), "no facets": stl([])},
    NonFiniteCoordinatesError: {
        "binary NaN": binary_stl([[[0, 0, 0], [1, 0, 0], [0, np.nan, 0]]]),
        "binary infinity": binary_stl([[[0, 0, 0], [1, 0, 0], [0, np.inf, 0]]]),
        "NaN": ASCII.replace(b"1.0", b"nan", 1),
        "infinity": ASCII.replace(b"1.0", b"-Infinity", 1),
    },
    DegenerateMeshError: {
        "binary one point": binary_stl(np.ones((4, 3, 3))),
        "one point": stl(np.ones((4, 3, 3))),
    },
    MeshTooComplexError: {"8,000 solids": stl(CORNERS[:1]) * 8_000, "40,000 empty solids": stl([]) * 40_000},
}


@faulty(BAD)
def test_bad(data, error):
    with pytest.raises(error):
        read_mesh(data, "stl")


def test_limit_of_solids():
    data = stl(CORNERS[:4]) + stl(CORNERS[4:8]) + stl(CORNERS[8:])
    assert len(read_mesh(data, "stl", limits=Limits(parts=3)).faces) == 12
    with pytest.raises(MeshTooComplexError, match="3 solids; the limit is 2"):
        read_mesh(data, "stl", limits=Limits(parts=2))
