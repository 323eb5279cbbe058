"""STEP assemblies: the distinct parts, and assemblies without end."""

import time

import numpy as np
import pytest

from core.errors import (
    DegenerateMeshError,
    EmptyFileError,
    MalformedMeshError,
    MeshTooComplexError,
    NoTrianglesError,
)
from core.io import DEFAULT_LIMITS, Limits, read_mesh, read_parts
from core.io.parts import NAME_CHARACTERS, clean_name
from core.io.step import check_products
from tests.core.io.files import off
from tests.core.io.step_files import (
    Step,
    step_assembly,
    step_box,
    step_circle,
    step_doubled,
    step_machine,
    step_sphere,
)

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


def test_one_part_of_several_instances():
    (box,) = read_parts(step_assembly(), "stp")
    assert (box.name, box.path, box.instances) == ("box", ("whole", "0"), 2)


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


def test_limits():
    assert len(read_parts(MACHINE, "step", limits=Limits(parts=9, distinct_parts=4))) == 4
    for fewer in (Limits(parts=8), Limits(distinct_parts=3), Limits(faces=100), Limits(vertices=100)):
        with pytest.raises(MeshTooComplexError, match="limit"):
            read_parts(MACHINE, "step", limits=fewer)


REFUSED = {
    "an assembly that contains itself": (step_circle(), MalformedMeshError),
    "a million instances": (step_doubled(20), MeshTooComplexError),
    "more than any number": (step_doubled(2_000), MeshTooComplexError),
    "a hundred thousand instances": (
        step_box().replace(END, b"#900=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',#1,#2,$);\n" * 100_000 + END),
        MeshTooComplexError,
    ),
}


@pytest.mark.parametrize("read", [read_mesh, read_parts])
@pytest.mark.parametrize("name", REFUSED)
def test_assemblies_without_end_are_refused_before_they_are_expanded(name, read):
    data, error = REFUSED[name]
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


def test_faults_of_files():
    with pytest.raises(EmptyFileError):
        read_parts(b"", "step")
    with pytest.raises(MalformedMeshError, match="gzip"):
        read_parts(b"\x1f\x8b", "step")
    with pytest.raises(MalformedMeshError, match="cut short"):
        read_parts(MACHINE[: len(MACHINE) // 2], "step")
    file = Step()
    file.product("nothing", [], file.context("millimetre"))
    with pytest.raises(NoTrianglesError, match="STEP"):
        read_parts(file.data(), "step")


def test_a_part_without_area_is_refused_by_its_name(monkeypatch):
    monkeypatch.setattr("core.io.read.is_degenerate", lambda mesh: len(mesh.faces) > 100)
    with pytest.raises(DegenerateMeshError, match="'ring'"):
        read_parts(MACHINE, "step")
