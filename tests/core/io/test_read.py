"""Reading and writing whatever the format: names, round trips, outside truth, and odd but sound meshes."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

import core.io
from core.errors import (
    DegenerateMeshError,
    EmptyFileError,
    MalformedMeshError,
    MeshError,
    MeshTooComplexError,
    NonFiniteCoordinatesError,
    NoTrianglesError,
    UnknownFormatError,
)
from core.io import FORMATS, Format, Limits, format_of, read_mesh, readable, writable, write_mesh
from core.io.checks import Content
from core.mesh.mesh import Mesh
from tests.core.io.files import CUBE, PLAIN, TRIANGLES
from tests.core.shapes import area, icosphere, volume

EXACT = ("obj", "off")


def test_names_of_formats():
    assert tuple(FORMATS) == readable() == (*PLAIN, "3mf", "step", "iges")
    assert writable() == (*PLAIN, "3mf")


def test_the_page_on_formats_has_a_row_for_each():
    page = (Path(core.io.__file__).parents[2] / "docs" / "formats.md").read_text()
    for format in FORMATS.values():
        (row,) = (line for line in page.splitlines() if line.startswith("|") and f"`.{format.name}`" in line)
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert cells[0].startswith(format.title)
        assert cells[1] == ", ".join(f"`.{ending}`" for ending in format.endings)
        assert cells[2] == ("with the extra `step`" if format.package else "yes")
        assert cells[3] in (("yes", "GLB") if format.is_written else ("no",))
        assert cells[4] == (format.unit or "not stated")
        assert cells[5] == ("y" if format.y_up else "z")


def read(data, limits):
    """Return a file of the toy format: nine numbers for each triangle."""
    corners = np.array(data.removeprefix(b"TOY").split(), dtype=float).reshape(-1, 3)
    return Content(corners, np.arange(len(corners)).reshape(-1, 3))


def test_a_format_is_added_by_its_module_and_a_row_of_the_table(monkeypatch):
    toy = Format(("toy", "toys"), __name__, magic=b"TOY")
    monkeypatch.setitem(FORMATS, "toy", toy)
    mesh = read_mesh(b"TOY 0 0 0  1 0 0  0 2 0", format_of("triangle.TOYS"))
    assert area(mesh) == 1.0
    with pytest.raises(MalformedMeshError, match="is of the format TOY"):
        read_mesh(b"TOY 0 0 0  1 0 0  0 2 0", "obj")
    with pytest.raises(UnknownFormatError, match="written: stl"):
        write_mesh(mesh, "toy")


@pytest.mark.parametrize(
    ("filename", "expected"),
    [
        ("a.stl", "stl"),
        ("A.OBJ", "obj"),
        ("x.tar.Ply", "ply"),
        ("../b/c.off", "off"),
        (".glb", "glb"),
        ("é .glb", "glb"),
        ("a.3MF", "3mf"),
        ("a.Step", "step"),
        ("a.STP", "step"),
        ("a.gltf", "glb"),
        ("scene.zip", "glb"),
        ("a.IGS", "iges"),
    ],
)
def test_format_of(filename, expected):
    assert format_of(filename) == expected


@pytest.mark.parametrize(
    "filename", ["", "stl", "a.", "a.fbx", "a.stl.gz", "a.stl/b", "a.dae", "a.stl\n", "/etc/passwd"]
)
def test_format_of_anything_else(filename):
    with pytest.raises(UnknownFormatError, match="stl, obj, ply, off, glb, 3mf, step, iges") as caught:
        format_of(filename)
    assert "passwd" not in str(caught.value)


@pytest.mark.parametrize("format", ["fbx", "dae", "", "stl_ascii", "json", "xyz", "dict"])
def test_only_the_formats_listed_are_read_or_written(format):
    with pytest.raises(UnknownFormatError):
        read_mesh(b"solid", format)
    with pytest.raises(UnknownFormatError):
        write_mesh(icosphere(0), format)


@pytest.mark.parametrize("format", ["step", "stp"])
def test_formats_without_a_writer_are_refused(format):
    with pytest.raises(UnknownFormatError, match="written: stl, obj, ply, off, glb, 3mf"):
        write_mesh(icosphere(0), format)


PLACES = np.repeat(np.arange(20_000), 3)
ODD = {
    "a triangle": Mesh(np.eye(3), [[0, 1, 2]]),
    "a needle": Mesh([[0, 0, 0], [1, 0, 0], [1, 2.0**-30, 0]], [[0, 1, 2]]),
    "a plane": Mesh([[x, y, 0] for x in range(4) for y in range(4)], [[0, 1, 4], [1, 5, 4], [10, 11, 15]]),
    "three faces on one edge": Mesh(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    ),
    "twenty thousand loose parts": Mesh(
        np.column_stack([PLACES // 200, PLACES % 200, 0 * PLACES]) + np.tile(np.eye(3) / 2, (20_000, 1)),
        np.arange(60_000).reshape(-1, 3),
    ),
    "one face with area": Mesh([*CUBE, [5.0, 5.0, 5.0]], [*[[8, 8, 8]] * 100, [0, 1, 2]]),
}


KINDS = {
    "Git LFS": b"version https://git-lfs.github.com/spec/v1\noid sha256:ab\nsize 1048576\n",
    "HTML": b"\n<!DOCTYPE html>\n<html><head><title>404 Not Found</title></head></html>\n",
    "FBX": b"Kaydara FBX Binary  \0" + bytes(100),
    "COLLADA": b'<?xml version="1.0"?>\n<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema">',
    "PDF": b"%PDF-1.7\n",
    "picture": b"\x89PNG\r\n\x1a\n" + bytes(50),
    "program": b"\x7fELF" + bytes(90),
}


def _reason(other):
    """What the message on a file of another format says; a binary STL begins as nothing else does."""
    return ".*" if other == "stl" else f"format {FORMATS[other].title}"


@pytest.mark.parametrize("format", PLAIN)
class TestEveryFormat:
    def test_empty(self, format):
        with pytest.raises(EmptyFileError):
            read_mesh(b"", format)

    @pytest.mark.parametrize("start", [b"\x1f\x8b\x08", b"PK\x03\x04", b"BZh9"])
    def test_compressed(self, format, start):
        with pytest.raises(MalformedMeshError, match=r"compressed|ZIP"):
            read_mesh(start + b"1AY&SY" + bytes(500), format)

    @pytest.mark.parametrize(
        "junk", [b"\0" * 300, b"hello\n" * 60, b" ", b"\n\n", bytes(range(256)), b"<?xml version='1.0'?>"]
    )
    def test_something_else(self, format, junk):
        with pytest.raises((EmptyFileError, MalformedMeshError, NoTrianglesError)):
            read_mesh(junk, format)

    @pytest.mark.parametrize("kind", KINDS)
    def test_what_is_saved_in_the_place_of_a_mesh_is_named(self, format, kind):
        with pytest.raises(MalformedMeshError, match=kind):
            read_mesh(KINDS[kind], format)

    @pytest.mark.parametrize("other", PLAIN)
    def test_another_format_under_this_name(self, format, other):
        data = write_mesh(icosphere(1), other)
        if format == other:
            assert len(read_mesh(data, format).faces) == 80
        else:
            with pytest.raises(MalformedMeshError, match=_reason(other)):
                read_mesh(data, format)

    def test_in_capitals(self, format):
        assert len(read_mesh(write_mesh(icosphere(1), format.upper()), format.upper()).faces) == 80

    @pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
    def test_round_trip(self, format, scale):
        mesh = icosphere(2, scale)
        again = read_mesh(write_mesh(mesh, format), format)
        tolerance = 0 if format in EXACT else 2 * np.finfo(np.float32).eps * scale
        if format == "stl":
            assert np.array_equal(again.faces.ravel(), np.arange(3 * len(mesh.faces)))
        else:
            assert np.array_equal(again.faces, mesh.faces)
            assert np.abs(again.vertices - mesh.vertices).max() <= tolerance
        assert np.abs(again.vertices[again.faces] - mesh.vertices[mesh.faces]).max() <= tolerance

    def test_vertices_that_no_face_uses(self, format):
        mesh = Mesh([[7.0, 7.0, 7.0], *CUBE, [9.0, 9.0, 9.0]], TRIANGLES + 1)
        again = read_mesh(write_mesh(mesh, format), format)
        assert again.vertices[again.faces] == pytest.approx(CUBE[TRIANGLES])
        assert len(again.vertices) == {"stl": 36, "glb": 8}.get(format, 10)

    def test_same_bytes_every_time(self, format):
        assert write_mesh(icosphere(2), format) == write_mesh(icosphere(2), format)

    def test_files_of_other_writers(self, format):
        """trimesh's own files, and its own area and volume."""
        torus = trimesh.creation.torus(major_radius=2, minor_radius=0.5)
        exported = torus.export(file_type=format)
        read = read_mesh(exported if isinstance(exported, bytes) else exported.encode(), format)
        unit = FORMATS[format].millimetres or 1.0
        assert len(read.faces) == len(torus.faces)
        assert area(read) == pytest.approx(torus.area * unit**2, rel=1e-5)
        assert volume(read) == pytest.approx(torus.volume * unit**3, rel=1e-5)

    @pytest.mark.parametrize("name", ODD)
    def test_odd_meshes_keep_their_faces_and_their_area(self, format, name):
        mesh = ODD[name]
        again = read_mesh(write_mesh(mesh, format), format)
        assert len(again.faces) == len(mesh.faces)
        assert area(again) == pytest.approx(area(mesh))

    @pytest.mark.parametrize(
        ("vertices", "faces"),
        [
            pytest.param(np.zeros((3, 3)), [[0, 1, 2]], id="origin"),
            pytest.param(np.full((3, 3), 0.1), [[0, 1, 2]], id="one point"),
            pytest.param(np.outer([1, 2, 3, 7], [0.125, 0.75, 0.25]), [[0, 1, 2], [1, 2, 3]], id="a line"),
            pytest.param(CUBE, [[0, 0, 1], [2, 3, 2], [5, 5, 5]], id="repeated corners"),
        ],
    )
    @pytest.mark.parametrize("scale", [2.0**-100, 1.0, 2.0**100])
    def test_no_area_at_all(self, format, vertices, faces, scale):
        # Powers of two in the unit of the format, so that a written line is straight.
        points = np.asarray(vertices) * scale * (FORMATS[format].millimetres or 1.0)
        with pytest.raises(DegenerateMeshError):
            read_mesh(write_mesh(Mesh(points, faces), format), format)

    def test_limits(self, format):
        data = write_mesh(icosphere(1), format)
        assert len(read_mesh(data, format, limits=Limits(faces=80, vertices=42)).faces) == 80
        for limits in (Limits(faces=79), Limits(vertices=41))[: 1 if format == "stl" else 2]:
            with pytest.raises(MeshTooComplexError, match="limit"):
                read_mesh(data, format, limits=limits)

    @pytest.mark.parametrize("part", [1, 10, 50, 84, 99])
    def test_cut_short(self, format, part):
        mesh = icosphere(2)
        data = write_mesh(mesh, format)
        cut = data[: len(data) * part // 100]
        if format == "obj" and cut.count(b"\nf") > 1:
            # An OBJ declares nothing: what is left of it is an OBJ, with the faces that are left.
            read = read_mesh(cut, format)
            assert np.array_equal(read.faces[:-1], mesh.faces[: len(read.faces) - 1])
        else:
            with pytest.raises(MeshError):
                read_mesh(cut, format)

    def test_more_than_32_bits_hold(self, format):
        mesh = Mesh(CUBE * 1e200, TRIANGLES)
        if format in EXACT:
            assert np.array_equal(read_mesh(write_mesh(mesh, format), format).vertices, mesh.vertices)
        else:
            with pytest.raises(NonFiniteCoordinatesError):
                write_mesh(mesh, format)


@pytest.mark.parametrize("format", EXACT)
@pytest.mark.parametrize("offset", [0, 100, -1e6])
def test_a_line_whose_points_are_rounded_has_no_area(format, offset):
    line = Mesh(np.outer([1, 2, 3, 7], [0.1, 0.7, 0.3]) + offset, [[0, 1, 2], [1, 2, 3]])
    with pytest.raises(DegenerateMeshError):
        read_mesh(write_mesh(line, format), format)
