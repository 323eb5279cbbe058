"""PLY: text and binary, what headers may declare, and what then has to follow."""

import struct

import numpy as np
import pytest

from core.errors import DegenerateMeshError, MalformedMeshError, NonFiniteCoordinatesError, NoTrianglesError
from core.io import read_file, read_mesh
from tests.core.io.files import CUBE, SQUARES, TRIANGLES, binary_ply, counted, faulty, lines, ply, ply_header

TEXT, BINARY = ply(), binary_ply()
BODY = (lines(CUBE) + lines(counted(SQUARES))).encode()
EDGES = b"element edge 2\nproperty int vertex1\nproperty int vertex2\nend_header"
COLOURS = ("uchar red", "uchar green", "uchar blue")
XYZ = ("float x", "float y", "float z")


def packed(rows, form):
    return b"".join(struct.pack(form, *row) for row in rows)


def binary(vertices, faces, form="binary_little_endian", **header):
    return ply_header(8, 6, form=form, **header) + vertices + faces


PLAIN_VERTICES, PLAIN_FACES = packed(CUBE, "<3f"), packed(counted(SQUARES), "<B4i")


# Lists of some lengths, each with its length.
SEEN = [[n, *range(n)] for n in (0, 1, 2, 3, 0, 2, 1, 5)]

SOUND = {
    "text": TEXT,
    "text, triangles": ply(polygons=TRIANGLES),
    "text, CRLF": TEXT.replace(b"\n", b"\r\n"),
    "text, CR": TEXT.replace(b"\n", b"\r"),
    "text, no last newline": TEXT.rstrip(),
    "text, blank lines": TEXT.replace(b"end_header\n", b"end_header\n\n \n") + b"\n\n",
    "text, types": ply(vertex=("double x", "float64 y", "float32 z")),
    "text, integers": ply(vertex=("int x", "short y", "uchar z"), vertices=CUBE.astype(int)),
    "comments": ply(more=["comment end_header", "obj_info x", "comment TextureFile ../a.png", ""]),
    "a comment not in ASCII": ply(more=["comment caf\xe9"]),
    "the other name": TEXT.replace(b"vertex_indices", b"vertex_index"),
    "other types of lists": TEXT.replace(b"uchar int vertex", b"int uint vertex"),
    "text, texture before the position": ply(
        vertices=np.hstack([CUBE + 5, CUBE]), vertex=("float s", "float t", "float u", *XYZ)
    ),
    "text, normals and colours": ply(
        vertices=np.hstack([CUBE, CUBE, 255 * CUBE.astype(int)]),
        vertex=(*XYZ, "float nx", "float ny", "float nz", *COLOURS),
    ),
    "text, lists before and values after": ply_header(
        8, 6, face=("uchar flag", "list uchar float texcoord", "list uchar int vertex_indices", "float q")
    )
    + (lines(CUBE) + lines([[1, 2, 0.5, 0.5, *row, 0.25] for row in counted(SQUARES)])).encode(),
    "text, colours of faces": ply_header(8, 6, face=("list uchar int vertex_indices", *COLOURS))
    + (lines(CUBE) + lines([[*row, 255, 0, 0] for row in counted(SQUARES)])).encode(),
    "text, another element first": ply_header(
        8, 6, more=["element camera 2", "property float view", "property list uchar int tags"]
    )
    + b"0.5 0\n0.5 2 1 2\n"
    + BODY,
    "text, edges last": TEXT.replace(b"end_header", EDGES) + b"0 1\n2 3\n",
    "text, lists in the vertices": ply(
        vertices=[[*SEEN[i], x, *SEEN[-i], y, z] for i, (x, y, z) in enumerate(CUBE)],
        vertex=("list uchar int a", "float x", "list int float b", "float y", "float z"),
    ),
    "text, whole numbers as floats": ply(face=("list float double vertex_indices",)).replace(
        b"\n4 0 1", b"\n4.0 0. 1.000"
    ),
    "binary": BINARY,
    "binary, equal lists in the vertices": binary(
        b"".join(struct.pack("<3fB2i", *row, 2, 7, 8) for row in CUBE),
        PLAIN_FACES,
        vertex=(*XYZ, "list uchar int a"),
    ),
    "binary, unequal lists in the vertices": binary(
        b"".join(
            struct.pack(f">H{i}ifB{i}hdf", i, *range(i), z, i, *range(i), x, y)
            for i, (x, y, z) in enumerate(CUBE)
        ),
        packed(counted(SQUARES), ">B4i"),
        form="binary_big_endian",
        vertex=("list ushort int a", "float z", "list uchar short b", "double x", "float y"),
    ),
    "binary, lengths and indices in floats": binary(
        PLAIN_VERTICES, packed(counted(SQUARES), "<f4d"), face=("list float double vertex_indices",)
    ),
    "binary, polygons of different size in floats": binary_ply(polygons=[])
    .replace(b"face 0", b"face 8")
    .replace(b"uchar int", b"float float")
    + packed([[4.0, *row] for row in SQUARES[:4].tolist()], "<5f")
    + packed([[3.0, *row] for row in TRIANGLES[8:].tolist()], "<4f"),
    "binary, other byte order": binary_ply(order=">"),
    "binary, other byte order, triangles": binary_ply(polygons=TRIANGLES, order=">"),
    "binary, CRLF": ply_header(8, 6, form="binary_little_endian").replace(b"\n", b"\r\n")
    + PLAIN_VERTICES
    + PLAIN_FACES,
    "binary, a newline last": BINARY + b"\n",
    "binary, doubles": binary(packed(CUBE, "<3d"), PLAIN_FACES, vertex=("double x", "double y", "double z")),
    "binary, more before the position": binary(
        packed(np.hstack([CUBE + 5, CUBE]), ">6f"),
        packed(counted(SQUARES), ">B4i"),
        form="binary_big_endian",
        vertex=("float u", "float v", "float nx", *XYZ),
    ),
    "binary, colours": binary(
        packed([[*row, 1, 2, 3] for row in CUBE], "<3f3B"),
        packed([[*row, 9] for row in counted(SQUARES)], "<B4if"),
        vertex=(*XYZ, *COLOURS),
        face=("list uchar int vertex_index", "float q"),
    ),
    "binary, other types of lists": binary(
        PLAIN_VERTICES, packed(counted(SQUARES), "<I4H"), face=("list uint ushort vertex_indices",)
    ),
    "binary, two lists": binary(
        PLAIN_VERTICES,
        packed([[1, 2, 0.5, 0.5, *row] for row in counted(SQUARES)], "<BB2fB4i"),
        face=("uchar flag", "list uchar float texcoord", "list uchar int vertex_indices"),
    ),
    "binary, other elements first": ply_header(
        8,
        6,
        form="binary_little_endian",
        more=[
            "element strip 2",
            "property list int int a",
            "element none 3",
            "element one 2",
            "property double b",
        ],
    )
    + struct.pack("<iii", 2, 7, 7)
    + struct.pack("<i", 0)
    + bytes(16)
    + PLAIN_VERTICES
    + PLAIN_FACES,
    "binary, edges last": BINARY.replace(b"end_header", EDGES) + bytes(16),
    "byte order mark": b"\xef\xbb\xbf" + TEXT,
    "UTF-16": TEXT.decode().encode("utf-16"),
    "a comment without the word": ply(more=["made by hand"]),
    "comments among the rows": TEXT.replace(b"\n4 0", b"\ncomment faces\n4 0", 1),
    "names that differ by capitals": ply(
        vertices=np.hstack([CUBE, CUBE[:, :2]]),
        vertex=("float x", "float y", "float z", "float s", "float S"),
    ),
    "capitals": ply(vertex=("float X", "float Y", "float Z")),
    "a third name": TEXT.replace(b"vertex_indices", b"vertex_indexes"),
    "polygons": TEXT.replace(b"element face", b"element polygon"),
    "binary, CRLF after the last line of the header": BINARY.replace(b"end_header\n", b"end_header\r\n"),
    "binary, halves": binary(packed(CUBE, "<3e"), PLAIN_FACES, vertex=("float16 x", "float16 y", "half z")),
}


@pytest.mark.parametrize("data", SOUND.values(), ids=SOUND)
def test_reads(data):
    file = read_file(data, "ply")
    assert np.array_equal(file.mesh.vertices, CUBE)
    assert np.array_equal(file.mesh.faces, TRIANGLES)
    assert not file.warnings


@pytest.mark.parametrize(
    "data",
    [ply(counts=(8, 5)), binary_ply(counts=(8, 5)), BINARY + b"more"],
    ids=["text", "binary", "a word"],
)
def test_bytes_after_the_last_row_are_left_out_with_a_warning(data):
    file = read_file(data, "ply")
    assert np.array_equal(file.mesh.faces, TRIANGLES[: len(file.mesh.faces)])
    assert len(file.mesh.faces) in (10, 12)
    assert len(file.warnings) == 1


STRIP = [0, 1, 2, 3, -1, 4, 6, 5, 7, 3]
STRIP_TRIANGLES = [[0, 1, 2], [2, 1, 3], [4, 6, 5], [5, 6, 7], [5, 7, 3]]


@pytest.mark.parametrize("lists", [[STRIP], [STRIP[:5], STRIP[5:]], [STRIP[:4], STRIP[5:]]])
@pytest.mark.parametrize("text", [True, False])
def test_strips_of_triangles_end_with_their_list_or_with_a_negative_index(lists, text):
    declared = ply_header(8, len(lists), form="ascii" if text else "binary_little_endian")
    head = declared.replace(b"element face", b"element tristrips").replace(b"uchar int", b"int int")
    body = (lines(CUBE) + lines(counted(lists))).encode()
    if not text:
        body = PLAIN_VERTICES + b"".join(struct.pack(f"<{len(row)}i", *row) for row in counted(lists))
    assert read_mesh(head + body, "ply").faces.tolist() == STRIP_TRIANGLES


@pytest.mark.parametrize("write", [ply, binary_ply, lambda v, p: binary_ply(v, p, order=">")])
@pytest.mark.parametrize(
    "polygons",
    [
        pytest.param([[0, 1, 3, 2], [4, 6, 7], [4, 7, 5]], id="a square first"),
        pytest.param([[0, 1, 3], [0, 3, 2], [4, 6, 7, 5]], id="a square last"),
        pytest.param([[], [0, 1, 3, 2], [1], [4, 6, 7, 5], [1, 2]], id="some with no area"),
    ],
)
def test_polygons_of_different_size(write, polygons):
    mesh = read_mesh(write(CUBE, polygons), "ply")
    assert mesh.faces.tolist() == [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]]
    assert np.array_equal(mesh.vertices, CUBE)


def header(*changes):
    data = TEXT
    for old, new in changes:
        assert old in data
        data = data.replace(old, new, 1)
    return data


HUGE = b"4000000000"
MALFORMED = {
    "not PLY": b"plx" + TEXT[3:],
    "header without an end": TEXT[: TEXT.index(b"end_header")],
    "no format": header((b"format ascii 1.0\n", b"")),
    "unknown format": header((b"ascii", b"binary_middle_endian")),
    "unknown type": header((b"float x", b"quad x")),
    "an index that is not whole": ply(face=("list uchar float vertex_indices",)).replace(
        b"\n4 0", b"\n4 0.5"
    ),
    "a length that is not whole": ply(face=("list float int vertex_indices",)).replace(b"\n4 0", b"\n4.5 0"),
    "binary, an index that is not whole": binary(
        PLAIN_VERTICES, packed([[4, 0.5, 1, 3, 2]] * 6, "<B4f"), face=("list uchar float vertex_indices",)
    ),
    "binary, a length that is no number": binary(
        PLAIN_VERTICES, packed([[np.nan, 0, 1, 3, 2]] * 6, "<f4i"), face=("list float int vertex_indices",)
    ),
    "a property before an element": header((b"element vertex", b"property int a\nelement vertex")),
    "count not a number": header((b"vertex 8", b"vertex eight")),
    "negative count": header((b"vertex 8", b"vertex -8")),
    "no z": header((b"float z", b"float w")),
    "x twice": header((b"float z", b"float x")),
    "vertices twice": header((b"element face", b"element vertex 0\nelement face")),
    "no vertices": header((b"element vertex 8", b"element point 8")),
    "no list of vertices": header((b"vertex_indices", b"corners")),
    "indices not in a list": header((b"list uchar int", b"int")),
    "a list in the vertices that is not there": header((b"float z", b"float z\nproperty list uchar int a")),
    "binary, a list in the vertices that is not there": BINARY.replace(
        b"float z", b"float z\nproperty list uint int a"
    ),
    "z in a list": header((b"float z", b"list uchar float z")),
    "text, 4e9 vertices": header((b"vertex 8", b"vertex " + HUGE)),
    "text, 4e9 faces": header((b"face 6", b"face " + HUGE)),
    "text, 4e9 of something else": header((b"element face", b"element x " + HUGE + b"\nelement face")),
    "text, 1e30 of something else": header((b"element face", b"element x 1" + b"0" * 30 + b"\nelement face")),
    "text, 2e6 vertices": header((b"vertex 8", b"vertex 2000000")),
    "text, a list of 4e9": header((b"\n4 0 1", b"\n" + HUGE + b" 0 1")),
    "text, a list longer than said": header((b"\n4 0 1 3 2", b"\n5 0 1 3 2")),
    "text, a negative list": header((b"\n4 0 1", b"\n-4 0 1")),
    "text, a list without a length": header((b"\n4 0 1 3 2", b"\nx 0 1 3 2")),
    "text, 300 in eight bits": ply(vertex=("float x", "float y", "uchar z"), vertices=300 * CUBE.astype(int)),
    "text, a whole number that is none": ply(vertex=("float x", "float y", "int z")).replace(
        b"0.0 0.0 0.0", b"0.0 0.0 nan", 1
    ),
    "text, a word beside the coordinates": ply(
        vertex=("float x", "float y", "float z", "float q"), vertices=np.c_[CUBE, CUBE[:, 0]]
    ).replace(b"0.0 0.0 0.0 0.0", b"0.0 0.0 0.0 no", 1),
    "text, a vertex too many": ply(counts=(9, 6)),
    "text, a vertex too few": ply(counts=(7, 6)),
    "text, a face too many": ply(counts=(8, 7)),
    "text, two coordinates": ply(vertices=CUBE[:, :2]),
    "text, four coordinates": ply(vertices=np.hstack([CUBE, CUBE[:, :1]])),
    "text, a word": header((b"1.0 1.0", b"1.0 one")),
    "text, a fractional index": ply(polygons=[[0, 1, 2.5]]),
    "text, index too large": ply(polygons=[[0, 1, 8]]),
    "text, negative index": ply(polygons=[[0, 1, -1]]),
    "text under the name of binary": header((b"ascii", b"binary_little_endian")),
    "binary, 4e9 vertices": binary_ply(counts=(4_000_000_000, 6)),
    "binary, 4e9 faces": binary_ply(counts=(8, 4_000_000_000)),
    "binary, 2e6 vertices": binary_ply(counts=(2_000_000, 6)),
    "binary, 4e6 faces": binary_ply(counts=(8, 4_000_000)),
    "binary, 4e9 of something else": BINARY.replace(
        b"element vertex", b"element x " + HUGE + b"\nproperty int a\nelement vertex"
    ),
    "binary, 4e9 lists": BINARY.replace(
        b"element vertex", b"element x " + HUGE + b"\nproperty list uchar int a\nelement vertex"
    ),
    "binary, a vertex too many": binary_ply(counts=(9, 6)),
    "binary, a vertex too few": binary_ply(counts=(7, 6)),
    "binary, a face too many": binary_ply(counts=(8, 7)),
    "binary, cut": BINARY[:-1],
    "binary, cut before its faces": BINARY[: -len(PLAIN_FACES)],
    "binary, cut, mixed": binary_ply(polygons=[[0, 1, 2], *SQUARES])[:-1],
    "binary, the other byte order": BINARY.replace(b"little", b"big"),
    "binary, a list of 4e9": binary(
        PLAIN_VERTICES,
        packed(counted(SQUARES), "<I4i").replace(b"\4\0\0\0", struct.pack("<I", 4 * 10**9), 1),
        face=("list uint int vertex_indices",),
    ),
    "binary, a negative list": binary(
        PLAIN_VERTICES,
        packed(counted(SQUARES), "<b4i").replace(b"\4\0\0\0\0", b"\xfc\0\0\0\0", 1),
        face=("list char int vertex_indices",),
    ),
    "binary, index too large": binary_ply(polygons=[[0, 1, 8]]),
    "binary, negative index": binary_ply(polygons=[[0, 1, -1]]),
    "binary, index beyond 63 bits": binary(
        PLAIN_VERTICES,
        packed([[4, 0, 1, 3, 2**64 - 6]] * 6, "<B4Q"),
        face=("list uchar uint64 vertex_indices",),
    ),
}
BAD = {
    MalformedMeshError: MALFORMED,
    NonFiniteCoordinatesError: {
        "text, NaN": header((b"1.0 1.0", b"1.0 nan")),
        "text, infinity": header((b"1.0 1.0", b"1.0 inf")),
        "text, too large for its type": header((b"1.0 1.0", b"1.0 1e99")),
        "binary, NaN": binary_ply(vertices=np.where(CUBE, np.nan, 0)),
        "binary, infinity": binary_ply(vertices=np.where(CUBE, np.inf, 0)),
    },
    NoTrianglesError: {
        "text, points": ply(polygons=[]),
        "text, points and no faces declared": header((b"element face 6", b"element edge 6")),
        "text, edges": ply(polygons=[[0, 1]] * 4),
        "binary, points": binary_ply(polygons=[]),
        "binary, edges": binary_ply(polygons=[[0, 1]] * 4),
    },
    DegenerateMeshError: {
        "text, one point": ply(vertices=np.ones((8, 3))),
        "binary, one point": binary_ply(vertices=np.ones((8, 3))),
    },
}


@faulty(BAD)
def test_bad(data, error):
    with pytest.raises(error):
        read_mesh(data, "ply")
