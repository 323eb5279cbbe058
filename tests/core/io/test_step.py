"""STEP, by cascadio: millimetres, parts of assemblies, and files that are refused."""

import time

import numpy as np
import pytest

from core.errors import (
    DegenerateMeshError,
    ExternalReferenceError,
    MalformedMeshError,
    MeshTooComplexError,
    NoTrianglesError,
    UnknownFormatError,
)
from core.io import DEFAULT_LIMITS, Limits, format_of, read_file, read_mesh, read_parts
from core.io.parts import NAME_CHARACTERS, clean_name
from core.io.step import check_products
from tests.core.io.files import faulty, off
from tests.core.io.iges_files import iges
from tests.core.io.step_files import (
    Step,
    step_assembly,
    step_box,
    step_circle,
    step_doubled,
    step_machine,
    step_sphere,
)
from tests.core.shapes import area

BOX = step_box()


def extent(mesh):
    return np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])


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


def elsewhere(entity, file=BOX):
    return file.replace(b"DATA;\n", b"DATA;\n#9000=" + entity + b"('passwd','','',#9001,'','');\n")


def without(kind):
    """The box without the entities of a kind, which others refer to."""
    return b"".join(line for line in BOX.splitlines(keepends=True) if kind not in line)


def of_no_solid():
    file = Step()
    file.product("nothing", [], file.context("millimetre"))
    return file.data()


REFUSED = {
    MalformedMeshError: {
        "prose": b"Dear Sir or Madam,\n",
        "a mesh": b"solid cube\nendsolid\n",
        "a header alone": b"ISO-10303-21;\nHEADER;\n",
        "cut in the middle": BOX[: len(BOX) // 2],
    },
    NoTrianglesError: {"no faces": without(b"ADVANCED_FACE"), "no solid": of_no_solid()},
    ExternalReferenceError: {"all in another file": elsewhere(b"DOCUMENT_FILE", of_no_solid())},
}


@pytest.mark.parametrize(
    "entity", [b"DOCUMENT_FILE", b"document_file", b"DCMFL", b"(DOCUMENT()DOCUMENT_FILE"]
)
def test_a_file_that_is_named_beside_the_geometry_is_left_out_with_a_warning(entity):
    file = read_file(elsewhere(entity), "step")
    assert np.array_equal(file.mesh.vertices, read_mesh(BOX, "step").vertices)
    assert len(file.warnings) == 1
    assert not read_parts(elsewhere(entity), "step")


@pytest.mark.parametrize("read", [read_mesh, read_parts])
@faulty(REFUSED)
def test_a_faulty_file_is_refused_by_its_cause(data, error, read):
    with pytest.raises(error) as caught:
        read(data, "step")
    assert type(caught.value) is error
    assert "passwd" not in str(caught.value)
    assert "GLB" not in str(caught.value)


def test_without_what_reads_it_the_answer_names_the_extra(monkeypatch):
    monkeypatch.setattr("core.io.formats.find_spec", lambda name: None)
    for ask in (lambda: format_of("bracket.stp"), lambda: read_mesh(BOX, "step")):
        with pytest.raises(UnknownFormatError, match=r"isoshape\[step\]"):
            ask()


MACHINE = step_machine()
END = b"ENDSEC;\nEND"


def named(name):
    """Two instances of a box of a name."""
    return step_assembly().replace(b"PRODUCT('box','box'", b"PRODUCT('box','" + name + b"'")


def test_each_product_is_a_part_with_its_instances():
    parts = read_parts(MACHINE, "step")
    assert [(part.name, part.path, part.instances) for part in parts] == [
        ("ring", ("machine", "use 3", "use 0"), 2),
        ("pin", ("machine", "use 3", "use 1"), 5),
        ("plate", ("machine", "use 6"), 1),
        ("plate", ("machine", "use 7"), 1),
    ]


def test_a_part_is_the_product_alone():
    ring, *boxes = (part.mesh for part in read_parts(MACHINE, "step"))
    for mesh, size in zip(boxes, ((1, 2, 3), (8, 8, 1), (9, 9, 1)), strict=True):
        expected = read_mesh(step_box(size), "step")
        assert np.array_equal(mesh.vertices, expected.vertices)
        assert np.array_equal(mesh.faces, expected.faces)
    # OpenCASCADE takes fewer triangles for a part in a large assembly.
    assert np.linalg.norm(ring.vertices, axis=1) == pytest.approx(np.full(len(ring.vertices), 2.0))
    assert 400 < len(ring.faces) <= len(read_mesh(step_sphere(2), "step").faces)


def test_the_instances_of_the_parts_make_up_the_whole():
    parts = read_parts(MACHINE, "step")
    whole = read_mesh(MACHINE, "step")
    assert sum(part.instances * len(part.mesh.faces) for part in parts) == len(whole.faces)
    assert sum(part.instances * len(part.mesh.vertices) for part in parts) == len(whole.vertices)


def test_several_products_without_an_assembly():
    file = Step()
    context = file.context("millimetre")
    for name, size in (("a", (1, 2, 3)), ("b", (4, 5, 6))):
        file.product(name, [file.box(size)], context)
    parts = read_parts(file.data(), "step")
    assert [(part.name, part.path, part.instances) for part in parts] == [("a", ("a",), 1), ("b", ("b",), 1)]


@pytest.mark.parametrize(
    ("data", "format"),
    [
        pytest.param(step_box(), "step", id="a solid"),
        pytest.param(step_assembly(places=[((1, 2, 3), (0, 0, 1), (1, 0, 0))]), "step", id="one instance"),
        pytest.param(off(), "off", id="a mesh"),
    ],
)
def test_a_file_of_one_part_has_none(data, format):
    assert read_parts(data, format) == []


def test_names_are_text_on_one_line():
    (part,) = read_parts(named(rb"\X2\00E4\X0\  M3 it''s"), "step")
    assert part.name == "\u00e4 M3 it's"
    (part,) = read_parts(named(b"x" * 10_000), "step")
    assert part.name == "x" * NAME_CHARACTERS
    assert clean_name(" a\nb\u202e\ud800 e\u0301 ") == "a b \u00e9"
    assert clean_name(None) == ""


def test_limits_of_parts():
    assert len(read_parts(MACHINE, "step", limits=Limits(parts=9, distinct_parts=4))) == 4
    for fewer in (Limits(parts=8), Limits(distinct_parts=3), Limits(faces=100), Limits(vertices=100)):
        with pytest.raises(MeshTooComplexError, match="limit"):
            read_parts(MACHINE, "step", limits=fewer)


MANY = b"#900=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',#1,#2,$);\n" * 100_000
ASSEMBLIES = {
    MalformedMeshError: {"an assembly that contains itself": step_circle()},
    MeshTooComplexError: {
        "a million instances": step_doubled(20),
        "more than any number": step_doubled(2_000),
        "a hundred thousand instances": step_box().replace(END, MANY + END),
    },
}


@pytest.mark.parametrize("read", [read_mesh, read_parts])
@faulty(ASSEMBLIES)
def test_assemblies_without_end_are_refused_before_they_are_expanded(data, error, read):
    start = time.process_time()
    with pytest.raises(error) as caught:
        read(data, "step")
    assert type(caught.value) is error
    # OpenCASCADE takes minutes over them, or crashes.
    assert time.process_time() - start < 5


@pytest.mark.parametrize(
    "text",
    [
        b"next_Assembly_Usage_Occurrence ( 'a''b,#1' ,\n'(;' , $ , %b , %b , $ )",
        b"#1=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',%b,%b,$)",
        b"#1=NAUO('','','',%b,%b,$)",
    ],
)
def test_an_instance_is_seen_however_it_is_written(text):
    data = step_box().replace(END, text % (b"#8", b"#9") + text % (b"#9", b"#8") + END)
    with pytest.raises(MalformedMeshError, match="a part of itself"):
        read_parts(data, "step")


def test_text_that_never_ends_takes_little_time():
    data = (
        b"NEXT_ASSEMBLY_USAGE_OCCURRENCE('" * 100_000 + b"NEXT_ASSEMBLY_USAGE_OCCURRENCE(" + b"," * 3_000_000
    )
    start = time.process_time()
    check_products(data, DEFAULT_LIMITS)
    assert time.process_time() - start < 5


def test_a_part_without_area_is_refused_by_its_name(monkeypatch):
    monkeypatch.setattr("core.io.read.is_degenerate", lambda mesh: len(mesh.faces) > 100)
    with pytest.raises(DegenerateMeshError, match="'ring'"):
        read_parts(MACHINE, "step")


PATCH = [(0, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1, 0)]


@pytest.mark.parametrize(("unit", "size"), [(1, 25.4), (2, 1.0), (6, 1e3)])
def test_an_iges_is_read_in_millimetres(unit, size):
    mesh = read_mesh(iges([PATCH, np.roll(PATCH, 1, axis=1)], unit), "iges")
    assert area(mesh) == pytest.approx(4 * size**2)
    assert extent(mesh) == pytest.approx(np.array([[0, 0, 0], [2, 2, 1]]) * size)


@pytest.mark.parametrize(
    "data", [iges([]), iges([PATCH])[:400], b"prose\n" * 20], ids=["empty", "cut", "prose"]
)
def test_a_faulty_iges_is_refused(data):
    with pytest.raises((MalformedMeshError, NoTrianglesError)):
        read_mesh(data, "iges")
