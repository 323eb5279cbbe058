"""STEP: solids made into triangles, their units and places, and what is wrong."""

import numpy as np
import pytest

from core.errors import (
    ExternalReferenceError,
    MalformedMeshError,
    MeshTooComplexError,
    NoTrianglesError,
    UnknownFormatError,
)
from core.io import Limits, format_of, read_mesh
from tests.core.io.step_files import Step, step_assembly, step_box, step_sphere

BOX = step_box()


def extent(mesh):
    return np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])


def area(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize(("unit", "size"), [("millimetre", 1), ("metre", 1e3)])
@pytest.mark.parametrize("format", ["step", "stp", "STEP"])
def test_a_box_is_read_in_millimetres(unit, size, format):
    mesh = read_mesh(step_box((1, 2, 3), unit), format)
    assert len(mesh.faces) == 12
    assert extent(mesh) == pytest.approx(np.array([[0, 0, 0], [1, 2, 3]]) * size)
    assert area(mesh) == pytest.approx(22 * size**2)


@pytest.mark.parametrize("radius", [0.01, 1, 5_000])
def test_a_sphere_has_as_many_triangles_whatever_its_size(radius):
    mesh = read_mesh(step_sphere(radius, centre=(radius, 0, 0)), "step")
    from_centre = np.linalg.norm(mesh.vertices - [radius, 0, 0], axis=1)
    assert from_centre == pytest.approx(np.full(len(from_centre), radius), rel=1e-5)
    assert area(mesh) == pytest.approx(4 * np.pi * radius**2, rel=0.02)
    assert 500 < len(mesh.faces) < 2_000


def test_an_assembly_has_its_parts_where_it_places_them():
    mesh = read_mesh(step_assembly(), "step")
    assert len(mesh.faces) == 24
    near, far = sorted(
        (mesh.vertices[mesh.faces[part]].reshape(-1, 3) for part in (slice(12), slice(12, 24))), key=np.max
    )
    assert near.max(axis=0) == pytest.approx([1, 2, 3])
    # Its x axis along y: (x, y, z) at (10 - y, x, z).
    assert far.min(axis=0) == pytest.approx([8, 0, 0])
    assert far.max(axis=0) == pytest.approx([10, 1, 3])


def test_the_same_bytes_give_the_same_mesh():
    first, second = (read_mesh(step_sphere(2), "step") for _ in range(2))
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.faces, second.faces)


def test_limits():
    places = [((10 * n, 0, 0), (0, 0, 1), (1, 0, 0)) for n in range(5)]
    data = step_assembly(places=places)
    assert len(read_mesh(data, "step", limits=Limits(faces=60, parts=5)).faces) == 60
    for fewer in (Limits(faces=59), Limits(vertices=100), Limits(parts=4)):
        with pytest.raises(MeshTooComplexError, match="limit"):
            read_mesh(data, "step", limits=fewer)


def elsewhere(entity):
    return BOX.replace(b"DATA;\n", b"DATA;\n#9000=" + entity + b"('passwd','','',#9001,'','');\n")


def without(kind):
    """The box without the entities of a kind, which others refer to."""
    return b"".join(line for line in BOX.splitlines(keepends=True) if kind not in line)


def of_no_solid():
    file = Step()
    file.product("nothing", [], file.context("millimetre"))
    return file.data()


REFUSED = {
    "prose": (b"Dear Sir or Madam,\n", MalformedMeshError),
    "a mesh": (b"solid cube\nendsolid\n", MalformedMeshError),
    "a header alone": (b"ISO-10303-21;\nHEADER;\n", MalformedMeshError),
    "cut in the middle": (BOX[: len(BOX) // 2], MalformedMeshError),
    "no faces": (without(b"ADVANCED_FACE"), NoTrianglesError),
    "no solid": (of_no_solid(), NoTrianglesError),
    "another file": (elsewhere(b"DOCUMENT_FILE"), ExternalReferenceError),
    "another file in small letters": (elsewhere(b"document_file"), ExternalReferenceError),
    "another file by the short name": (elsewhere(b"DCMFL"), ExternalReferenceError),
    "another file, in a complex entity": (elsewhere(b"(DOCUMENT()DOCUMENT_FILE"), ExternalReferenceError),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_faulty_file_is_refused_by_its_cause(name):
    data, error = REFUSED[name]
    with pytest.raises(error) as caught:
        read_mesh(data, "step")
    assert type(caught.value) is error
    assert "passwd" not in str(caught.value)
    assert "GLB" not in str(caught.value)


def test_without_what_reads_it_the_answer_names_the_extra(monkeypatch):
    monkeypatch.setattr("core.io.formats.find_spec", lambda name: None)
    for ask in (lambda: format_of("bracket.stp"), lambda: read_mesh(BOX, "step")):
        with pytest.raises(UnknownFormatError, match=r"isoshape\[step\]"):
            ask()
