"""STL: telling binary from ASCII, what writers vary, and what is wrong."""

import re

import numpy as np
import pytest

from core.errors import DegenerateMeshError, MalformedMeshError, NonFiniteCoordinatesError, NoTrianglesError
from core.io import read_file, read_mesh
from core.io import stl as module
from tests.core.io.files import CUBE, SQUARES, TRIANGLES, binary_stl, faulty, stl
from tests.core.shapes import area, volume

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
    "no normal": ASCII.replace(b"normal 0 0 1", b"", 1),
    "normals of Microsoft's C library": ASCII.replace(b"normal 0 0 1", b"normal -1.#IND -1.#IND -1.#IND"),
    "every end in two words": ASCII.replace(b"end", b"end "),
    "comments": b"# made by hand\n" + ASCII.replace(b"loop\n", b"loop # of three\n"),
    "decimal commas": ASCII.replace(b".0", b",0"),
    "UTF-16": ASCII.decode().encode("utf-16"),
    "zeros after the end": ASCII + bytes(64),
    "binary without its last attribute": BINARY[:-2],
    "binary of MZ": binary_stl(CORNERS, header=b"MZ_bracket"),
    "binary of a drawing": binary_stl(CORNERS, header=b"AC1015 part"),
}


@pytest.mark.parametrize("data", SOUND.values(), ids=SOUND)
def test_reads(data):
    mesh = read_mesh(data, "stl")
    assert np.array_equal(mesh.vertices[mesh.faces], CORNERS)


WARNED = {
    "count 2^32 - 1": (binary_stl(CORNERS, count=2**32 - 1), 12),
    "count one too large": (binary_stl(CORNERS, count=13), 12),
    "count one too small": (binary_stl(CORNERS, count=11), 12),
    "count 0 before facets": (binary_stl(CORNERS, count=0), 12),
    "binary cut in its last facet": (BINARY[:-20], 11),
    "binary that begins with solid, cut": (binary_stl(CORNERS, header=b"solid x")[:-1], 11),
    "bytes after the last facet": (BINARY + b"\n", 12),
    "bytes after the number of facets": (binary_stl(CORNERS, count=11) + b"\n", 11),
    "ASCII cut before its end": (ASCII[: ASCII.index(b"endsolid")], 12),
    "text after the end": (ASCII + b"; made by hand\n", 12),
}


@pytest.mark.parametrize(("data", "facets"), WARNED.values(), ids=WARNED)
def test_what_is_whole_is_read_with_a_warning(data, facets):
    file = read_file(data, "stl")
    assert np.array_equal(file.mesh.vertices[file.mesh.faces], CORNERS[:facets])
    assert len(file.warnings) == 1
    # A warning of the counts names two that differ.
    numbers = re.findall("[0-9]+", file.warnings[0])
    assert not numbers or len(set(numbers)) > 1
    assert not any(read_file(sound, "stl").warnings for sound in SOUND.values())


def test_facets_of_more_than_three_corners_are_polygons():
    mesh = read_mesh(stl([*CUBE[SQUARES[:5]], *CUBE[TRIANGLES[10:]]]), "stl")
    assert area(mesh) == 6.0
    assert volume(mesh) == pytest.approx(1.0)


def test_many_blocks_of_facets():
    """More than the megabyte that is looked at in one go, so that cuts fall between facets."""
    offsets = np.arange(8000)[:, None, None]
    triangles = np.eye(3) + offsets * 0.5
    mesh = read_mesh(stl(triangles), "stl")
    assert np.array_equal(mesh.vertices[mesh.faces], triangles)


MALFORMED = {
    "binary cut in the middle": BINARY[: len(BINARY) // 2],
    "half a header": binary_stl(CORNERS, header=b"part")[:40],
    "ASCII cut in a facet": ASCII[: len(ASCII) // 2],
    "ASCII cut in a number": ASCII[: ASCII.rindex(b"1.0")],
    "a second solid cut": ASCII + ASCII[:-30],
    "a solid in a solid": b"solid a\n" + ASCII + b"endsolid a\n",
    "an end without a beginning": ASCII + b"endsolid\n",
    "facets after the end": ASCII + FACET,
    "a number missing": ASCII.replace(b"1.0\n", b"\n", 1),
    "a number too many": ASCII.replace(b"1.0\n", b"1.0 1.0\n", 1),
    "a word for a number": ASCII.replace(b"1.0", b"one", 1),
    "a vertex missing": stl([*CORNERS, CUBE[:2]]),
    "a facet of four beside one of two": stl([*CORNERS, CUBE[:4], CUBE[:2]]),
    "words for numbers": b"solid\n" + b"facet outer loop vertex " * 20_000,
    "no loop": ASCII.replace(b"outer loop", b"", 1),
}
BAD = {
    MalformedMeshError: MALFORMED,
    NoTrianglesError: {
        "40,000 empty solids": stl([]) * 40_000,
        "binary with no facets": binary_stl([]),
        "no facets": stl([]),
        "only the word": b"solid",
    },
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
}


@faulty(BAD)
def test_bad(data, error):
    with pytest.raises(error):
        read_mesh(data, "stl")


def test_many_solids_are_read_together(monkeypatch):
    """A block of text has a cost of its own."""
    blocks, coordinates = [], module.coordinates
    monkeypatch.setattr(module, "coordinates", lambda lines: blocks.append(len(lines)) or coordinates(lines))
    mesh = read_mesh(stl(CORNERS[:1]) * 5_000 + stl(CORNERS), "stl")
    assert np.array_equal(mesh.vertices.reshape(-1, 3, 3), np.concatenate([[CORNERS[0]] * 5_000, CORNERS]))
    assert len(blocks) <= 2


def test_a_facet_does_not_go_on_in_another_solid():
    facet = stl(CORNERS[:1])
    begun, ended = facet.index(b"    vertex"), facet.index(b"  endloop")
    middle = b"endsolid cube\nsolid cube\n"
    with pytest.raises(MalformedMeshError):
        read_mesh(facet[:begun] + middle + facet[begun:], "stl")
    with pytest.raises(MalformedMeshError):
        read_mesh(facet[:ended] + middle + facet[ended:], "stl")
