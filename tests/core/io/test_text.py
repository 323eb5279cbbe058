"""OFF and OBJ: what their writers vary, and what is wrong."""

import numpy as np
import pytest

from core.errors import (
    DegenerateMeshError,
    MalformedMeshError,
    MeshTooComplexError,
    NonFiniteCoordinatesError,
    NoTrianglesError,
)
from core.io import Limits, read_file, read_mesh
from tests.core.io.files import CUBE, SQUARES, TRIANGLES, counted, faulty, lines, obj, off
from tests.core.shapes import area

V, F = lines(CUBE, "v "), lines(SQUARES + 1, "f ")
PENTAGON = np.array([[np.cos(a), np.sin(a), 0] for a in np.arange(5) * 2 * np.pi / 5])


def corners(suffix):
    """The faces, each corner with a suffix."""
    return lines([[f"{i}{suffix}" for i in row] for row in SQUARES + 1], "f ")


def is_cube(mesh):
    return np.array_equal(mesh.vertices, CUBE) and np.array_equal(mesh.faces, TRIANGLES)


WEIGHTS = np.array([1.0, 2.0, 0.5, 4.0] * 2)[:, None]
HOMOGENEOUS = np.hstack([WEIGHTS * CUBE, WEIGHTS])
SOUND_OFF = {
    "plain": off(),
    "triangles": off(polygons=TRIANGLES),
    "counts on the line of the word": off(header="OFF "),
    "no space after the word": off(header="OFF"),
    "small letters": off(header="off\n"),
    "blank lines first": off(header="\n\n  OFF\n"),
    "comments": off(header="# made by hand OFF\nOFF # really\n\n#\n"),
    "byte order mark": b"\xef\xbb\xbf" + off(),
    "CRLF": off().replace(b"\n", b"\r\n"),
    "CR": off().replace(b"\n", b"\r"),
    "tabs": off().replace(b" ", b"\t "),
    "no last newline": off().rstrip(),
    "blank lines last": off() + b"\n \n\n",
    "many blank lines": off().replace(b"\n", b"\n" * 10_000),
    "not ASCII": off(header="OFF\n# h\xe9\n"),
    "not UTF-8": off(header="OFF\n#")[:5] + b"\xff\xfe\n" + off(header=""),
    "no number of edges": off(counts=(8, 6)),
    "normals": off(header="NOFF\n", vertices=np.hstack([CUBE, CUBE])),
    "colours": off(header="COFF\n", vertices=np.hstack([CUBE, CUBE, [[0.5]] * 8])),
    "all of them": off(header="STCNOFF\n", vertices=np.tile(CUBE, 4)),
    "four coordinates": off(header="4OFF\n", vertices=HOMOGENEOUS),
    "four coordinates and colours": off(header="C4OFF\n", vertices=np.hstack([HOMOGENEOUS, CUBE])),
    "four coordinates, wrapped": off(header="4OFF\n", vertices=HOMOGENEOUS.reshape(16, 2), counts=(8, 6, 0)),
    "the number of coordinates": off(header="nOFF\n3\n"),
    "the number of coordinates on the line of the word": off(header="nOFF 3\n"),
    "the number of coordinates on the line of the counts": off(header="nOFF 3 "),
    "colours of faces": b"OFF\n8 6 0\n"
    + (lines(CUBE) + lines([[*row, 0.5, 0.25, 1] for row in counted(SQUARES)])).encode(),
    "whole colours of faces": b"OFF\n8 6 0\n"
    + (lines(CUBE) + lines([[*row, 255, 0, 0] for row in counted(SQUARES)])).encode(),
    "points and edges": off(polygons=[[0], [0, 1], *SQUARES.tolist(), []]),
    "no word": off(header=""),
    "UTF-16": off().decode().encode("utf-16"),
    "rows that are not lines": off().replace(b"\n", b" ").replace(b" ", b"\n", 1),
    "rows that are longer than lines": off().replace(b" ", b"\n").replace(b"\n", b" ", 3),
    "decimal commas": off().replace(b".0", b",0"),
    "commas between": off().replace(b".0 ", b".0, "),
    "Fortran": off().replace(b".0", b".0D+00"),
    "minus signs": off().replace(b"\n0.0", "\n\N{MINUS SIGN}0.0".encode()),
    "zeros and the end of CP/M": off() + bytes(8) + b"\x1a",
}


@pytest.mark.parametrize("data", SOUND_OFF.values(), ids=SOUND_OFF)
def test_off(data):
    file = read_file(data, "off")
    assert is_cube(file.mesh)
    assert not file.warnings


def test_bytes_after_the_last_row_are_left_out_with_a_warning():
    file = read_file(off(counts=(8, 5)), "off")
    assert np.array_equal(file.mesh.faces, TRIANGLES[:10])
    assert len(file.warnings) == 1


# A vertex with two texture coordinates stays one vertex.
SEAMS = "".join(f"f {a}/{i + 1} {b}/{i + 2} {c}/{i + 3}\n" for i, (a, b, c) in enumerate(TRIANGLES + 1))
SOUND_OBJ = {
    "seams": (V + "vt 0 0\n" * 20 + SEAMS).encode(),
    "plain": obj(),
    "triangles": obj(polygons=TRIANGLES),
    "CRLF": obj().replace(b"\n", b"\r\n"),
    "CR": obj().replace(b"\n", b" \r"),
    "no last newline": obj().rstrip(),
    "many blank lines": obj().replace(b"\n", b"\n" * 10_000),
    "indented": obj().replace(b"\nv", b"\n\t v").replace(b" ", b"  \t"),
    "comments": b"\xef\xbb\xbf# caf\xc3\xa9\n" + obj().replace(b"\n", b" # x\n"),
    "lines that go on": obj().replace(b" 0.0\n", b" \\\n0.0\n"),
    "a folder in a comment": b"# C:\\a\\\n" + obj().replace(b" 0.0\n", b" \\\n0.0\n"),
    "faces first": (F + V).encode(),
    "v/vt": (V + "vt 0 0\n" + corners("/1")).encode(),
    "v/": (V + "vt 0 0\n" + corners("/")).encode(),
    "v//vn": (V + "vn 0 0 1\n" + corners("//1")).encode(),
    "v/vt/vn": (V + "vt 0 0\nvn 0 0 1\n" + corners("/1/1")).encode(),
    "relative textures": (V + "vt 0 0\nvn 0 0 1\n" + corners("/-1/-1")).encode(),
    "mixed forms": (V + F.replace("f 1 ", "f 1/9/9 ")).encode(),
    "colours": lines(np.hstack([CUBE, CUBE]), "v ").encode() + F.encode(),
    "weights": lines(np.hstack([CUBE, [[1.0]] * 8]), "v ").encode() + F.encode(),
    "weights on some": (V.replace("\n", " 1\n", 3) + F).encode(),
    "points and lines": (V + "p 1 2 3\nl 1 2\nvp 1 1\ncstype bezier\nf\n" + F).encode(),
    "a face of two corners": (V + "f 1 2\n" + F).encode(),
    "groups": (V + F.replace("f", "o a\ng b c\ns off\nusemtl d\nf")).encode(),
    "5,000 groups and materials": (
        V + "".join(f"g {i}\nusemtl m{i}\no {i}\n" for i in range(5_000)) + F
    ).encode(),
    "relative": (V + lines(SQUARES - 8, "f ")).encode(),
    "both": (V + lines(SQUARES[:3] - 8, "f ") + lines(SQUARES[3:] + 1, "f ")).encode(),
    "relative to what is above": (
        lines(CUBE[:4], "v ")
        + lines(SQUARES[:1] - 4, "f ")
        + lines(CUBE[4:], "v ")
        + lines(SQUARES[1:] - 8, "f ")
    ).encode(),
    "relative and not in one face": (V + F.replace("f 1 ", "f -8 ")).encode(),
    "capitals": (V + F).upper().encode(),
    "the face of old versions": (V + F.replace("f", "fo")).encode(),
    "blanks after what goes on": obj().replace(b" 0.0\n", b" \\ \n0.0\n"),
    "UTF-16": (V + F).encode("utf-16"),
    "a comment of signs": obj().replace(b" 0.0\n", b" \\\n0.0\n") + b"#" * 1_000_000 + b"\n",
    "commas": (V.replace(" 0.0 ", " 0.0, ") + F).encode(),
    "decimal commas": (V.replace(".", ",") + F).encode(),
}


@pytest.mark.parametrize("data", SOUND_OBJ.values(), ids=SOUND_OBJ)
def test_obj(data):
    assert is_cube(read_mesh(data, "obj"))


@pytest.mark.parametrize("number", ["nan", "-nan(ind)", "1.#QNAN", "inf", "-1.#INF", "1e999"])
def test_a_vertex_of_no_face_does_not_count(number):
    mesh = read_mesh((f"v {number} 0 0\n" + V + lines(SQUARES + 2, "f ")).encode(), "obj")
    assert np.array_equal(mesh.vertices[mesh.faces], CUBE[TRIANGLES])
    assert np.array_equal(mesh.vertices[0], CUBE[TRIANGLES[0, 0]])


@pytest.mark.parametrize("write", [off, obj])
@pytest.mark.parametrize(
    "polygons",
    [
        pytest.param([[0, 1, 2, 3, 4]], id="all alike"),
        pytest.param([[0, 1, 2, 3], [0, 3, 4]], id="mixed"),
        pytest.param([[0, 1, 2], [0, 2, 3], [0, 3, 4]], id="triangles"),
    ],
)
def test_polygons_are_cut_into_fans(write, polygons):
    read = read_mesh(write(PENTAGON, polygons), write.__name__)
    assert read.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert area(read) == pytest.approx(5 / 2 * np.sin(2 * np.pi / 5))


@pytest.mark.parametrize(
    "number", ["1e-3", "1E+3", "+.5", "-1.", "4.9e-324", "0.1", "00012.5", "123456.789012345678"]
)
def test_numbers_are_read_as_python_reads_them(number):
    data = obj().replace(b"v 0.0 0.0 0.0", b"v 0.0 0.0 %b" % number.encode())
    assert read_mesh(data, "obj").vertices[0, 2] == float(number)
    data = off().replace(b"\n0.0 0.0 0.0", b"\n0.0 0.0 %b" % number.encode())
    assert read_mesh(data, "off").vertices[0, 2] == float(number)


MALFORMED_OFF = {
    "not OFF": off(header="FOO\n"),
    "OFF BINARY": off(header="OFF BINARY\n"),
    "four coordinates of three": off(header="4OFF\n"),
    "no number of coordinates": off(header="nOFF\n"),
    "five coordinates": off(header="nOFF\n5\n", vertices=np.hstack([CUBE, CUBE[:, :2]])),
    "more than one kind of coordinates": off(header="4nOFF\n3\n", vertices=HOMOGENEOUS),
    "no counts": b"OFF\n",
    "one count": b"OFF\n8\n",
    "negative count": off(counts=(-8, 6, 0)),
    "count not a number": off(counts=("eight", 6, 0)),
    "4e9 vertices": off(counts=(4_000_000_000, 6, 0)),
    "4e9 faces": off(counts=(8, 4_000_000_000, 0)),
    "2e6 vertices declared": off(counts=(2_000_000, 6, 0)),
    "a vertex too many": off(counts=(9, 6, 0)),
    "a vertex too few": off(counts=(7, 6, 0)),
    "a face too many": off(counts=(8, 7, 0)),
    "two coordinates": off(vertices=CUBE[:, :2]),
    "a word for a coordinate": off().replace(b"1.0", b"one", 1),
    "two points": off().replace(b"1.0", b"1.0.0", 1),
    "index too large": off(polygons=[[0, 1, 8]]),
    "negative index": off(polygons=[[0, 1, -1]]),
    "fractional index": off(polygons=[[0, 1, 2.5]]),
    "a thousand as Python writes it": off(polygons=[[0, 1, "0_2"], [0, 1, 2, 3]]),
    "index beyond 64 bits": off(polygons=[[0, 1, 2**70]]),
    "fewer corners than said": off().replace(b"4 0 1 3 2", b"5 0 1 3 2"),
    "4e9 corners": off().replace(b"4 0 1 3 2", b"4000000000 0 1 3 2"),
    "negative corners": off().replace(b"4 0 1 3 2", b"-4 0 1 3 2"),
    "zero bytes": off().replace(b"OFF\n", b"OFF\n\0"),
}
BAD_OFF = {
    MalformedMeshError: MALFORMED_OFF,
    NoTrianglesError: {
        "points only": off(polygons=[]),
        "edges only": off(polygons=[[0, 1], [2, 3]]),
        "nothing": b"OFF\n0 0 0\n",
    },
    NonFiniteCoordinatesError: {
        "NaN": off().replace(b"1.0", b"nan", 1),
        "infinity": off().replace(b"1.0", b"-inf", 1),
        "beyond 64 bits": off().replace(b"1.0", b"1e999", 1),
    },
    DegenerateMeshError: {"one point": off(vertices=np.ones((8, 3)))},
}
MALFORMED_OBJ = {
    "index 0": (V + "f 0 1 2\n").encode(),
    "index 0 among sound ones": (V + F + "f 1/1/1 00/1/1 3/1/1\n").encode(),
    "index too large": (V + "f 1 2 9\n").encode(),
    "counts back too far": (V + "f -1 -2 -9\n").encode(),
    "counts back past the first above": ("f -1 -2 -3\n" + V + F).encode(),
    "fractional index": (V + "f 1 2 3.5\n").encode(),
    "a word for an index": (V + "f 1 2 three\n").encode(),
    "one corner without a vertex": (V + "f 1/1 /1 3/1 4/1\n" + F).encode(),
    "slash first": (V + "f /1 /2 /3\n" + F).encode(),
    "index beyond 64 bits": (V + f"f 1 2 {2**64 + 3}\n").encode(),
    "two coordinates": (V + "v 1 2\n" + F).encode(),
    "no coordinates": (V + "v \n" + F).encode(),
    "an underscore in a coordinate": (V + F).replace("1.0", "1_0", 1).encode(),
    "a word for a coordinate": (V + F).replace("1.0", "one", 1).encode(),
    "a comma for a point": (V + F).replace("1.0", "1,0", 1).encode(),
    "no vertices": F.encode(),
    "zero bytes": (V + "\0" + F).encode(),
}
BAD_OBJ = {
    MalformedMeshError: MALFORMED_OBJ,
    NoTrianglesError: {
        "points only": (V + "p 1\n").encode(),
        "lines only": (V + "l 1 2 3\n").encode(),
        "faces of two corners": (V + "f 1 2\nf 2 3\n").encode(),
    },
    NonFiniteCoordinatesError: {
        "NaN": (V + F).replace("1.0", "NaN", 1).encode(),
        "NaN of Microsoft's C library": (V + F).replace("1.0", "-nan(ind)", 1).encode(),
        "infinity": (V + F).replace("1.0", "inf", 1).encode(),
        "beyond 64 bits": (V + F).replace("1.0", "-1e999", 1).encode(),
    },
    DegenerateMeshError: {"one repeated point": (V + "f 1 1 1\nf 2 2 2\n").encode()},
}


@faulty(BAD_OFF)
def test_bad_off(data, error):
    with pytest.raises(error) as caught:
        read_mesh(data, "off")
    message = str(caught.value)
    assert message[0].islower() or message.startswith("OFF")
    assert not any(sign in message for sign in ("Error", "array(", "b'", "<", "site-packages", "\n"))


@faulty(BAD_OBJ)
def test_bad_obj(data, error):
    with pytest.raises(error):
        read_mesh(data, "obj")


@pytest.mark.filterwarnings("error")
def test_blank_vertices_are_refused_without_a_warning():
    with pytest.raises(MalformedMeshError, match="fewer than three coordinates"):
        read_mesh(b"v \nv \nv \nf 1 2 3\n", "obj")


def test_files_that_an_obj_names_are_not_opened(monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("a file was opened")

    data = b"mtllib ../../../etc/passwd\nmtllib file:///etc/passwd\nusemtl x\ncall /etc/passwd\n" + obj()
    read_mesh(data, "obj")
    monkeypatch.setattr("builtins.open", refuse)
    assert is_cube(read_mesh(data, "obj"))


def test_a_polygon_counts_as_the_triangles_it_is_cut_into():
    data = off(vertices=np.tile(PENTAGON, (20, 1)), polygons=[list(range(100))])
    assert len(read_mesh(data, "off", limits=Limits(faces=98)).faces) == 98
    with pytest.raises(MeshTooComplexError, match="98 triangles"):
        read_mesh(data, "off", limits=Limits(faces=97))
