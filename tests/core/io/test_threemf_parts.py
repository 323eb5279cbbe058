"""The parts of a 3MF: its objects, and how it places them."""

import numpy as np
import pytest

from core.errors import (
    DegenerateMeshError,
    MalformedMeshError,
    MeshTooComplexError,
    NoTrianglesError,
)
from core.io import Limits, read_mesh, read_parts
from tests.core.io.files import CUBE, TRIANGLES
from tests.core.io.threemf_files import components, mesh, model, package, thing

MOVED = "1 0 0 0 1 0 0 0 1 10 20 30"
TURNED = "0 1 0 -1 0 0 0 0 1 5 0 0"
SLIGHTLY = "0.866025 0.5 0 -0.5 0.866025 0 0 0 1 0 0 0"
DOUBLED = "2 0 0 0 2 0 0 0 2 0 0 0"
DOUBLED_AND_TURNED = "0 2 0 -2 0 0 0 0 2 1 1 1"
MIRRORED = "-1 0 0 0 1 0 0 0 1 0 0 0"
FLAT = "1 0 0 0 1 0 0 0 0 0 0 0"
HALF = mesh(np.asarray(CUBE) / 2)


def parts_of(objects, items, **limits):
    found = read_parts(package(model(objects, items)), "3mf", limits=Limits(**limits))
    return [(part.name, part.path, part.instances) for part in found]


def test_each_object_is_a_part_with_its_instances():
    objects = (
        thing(1, name="pin")
        + thing(2, HALF, name="cap")
        + thing(3, components((1, None), (1, MOVED), (2, TURNED)), name="bearing")
    )
    assert parts_of(objects, [(3, None), (3, MOVED), (2, SLIGHTLY)]) == [
        ("pin", ("bearing", "pin"), 4),
        ("cap", ("bearing", "cap"), 3),
    ]


def test_a_part_is_in_its_own_frame_in_millimetres():
    data = package(model(thing(1), [(1, MOVED), (1, SLIGHTLY)], head='unit="inch"'))
    (part,) = read_parts(data, "3mf")
    assert part.instances == 2
    assert np.array_equal(part.mesh.vertices, np.asarray(CUBE, dtype=float) * 25.4)
    assert np.array_equal(part.mesh.faces, TRIANGLES)


def test_an_object_without_a_name_has_that_of_the_object_above():
    objects = thing(1) + thing(2, HALF, name="cap") + thing(3, components((1, None), (2, None)), name="pen")
    assert parts_of(objects, [(3, None), (1, None)]) == [
        ("pen", ("pen",), 1),
        ("cap", ("pen", "cap"), 1),
        ("", (), 1),
    ]


def test_instances_of_another_size_are_another_part():
    assert parts_of(thing(1, name="a"), [(1, DOUBLED), (1, None), (1, DOUBLED_AND_TURNED)]) == [
        ("a", ("a",), 2),
        ("a", ("a",), 1),
    ]
    large, small = read_parts(package(model(items=[(1, DOUBLED_AND_TURNED), (1, None)])), "3mf")
    assert large.mesh.vertices == pytest.approx(2 * small.mesh.vertices)


def test_small_and_large_sizes_keep_their_digits():
    for size in (1.2345678e-4, 1234.5678):
        scaled = f"{size} 0 0 0 {size} 0 0 0 {size} 0 0 0"
        part, _ = read_parts(package(model(items=[(1, scaled), (1, None)])), "3mf")
        assert part.mesh.vertices == pytest.approx(size * np.asarray(CUBE), rel=1e-6)


def test_a_mirrored_instance_is_another_part_with_its_inside():
    plain, mirrored = (
        part.mesh for part in read_parts(package(model(items=[(1, None), (1, MIRRORED)])), "3mf")
    )
    assert [volume(each) for each in (plain, mirrored)] == pytest.approx([volume(plain)] * 2)
    assert volume(plain) > 0


def test_the_parts_have_the_volume_of_the_whole():
    objects = thing(1) + thing(2, HALF) + thing(3, components((1, SLIGHTLY), (2, "3 0 0 1 1 0 0 0 -2 7 7 7")))
    data = package(model(objects, [(3, DOUBLED_AND_TURNED), (3, None), (2, MIRRORED)]))
    parts = read_parts(data, "3mf")
    assert sum(part.instances for part in parts) == 5
    total = sum(part.instances * volume(part.mesh) for part in parts)
    assert total == pytest.approx(volume(read_mesh(data, "3mf")), rel=1e-5)


def volume(one):
    a, b, c = np.moveaxis(one.vertices[one.faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_one_object_has_no_parts():
    assert parts_of(thing(1), [(1, MOVED)]) == []
    assert parts_of(thing(1) + thing(2, type="support"), [(1, None), (2, None)]) == []


def test_limits_and_faults():
    objects = thing(1) + thing(2, HALF)
    items = [(1, None), (2, None), (1, MOVED)]
    assert len(parts_of(objects, items, parts=3, distinct_parts=2)) == 2
    for fewer in ({"parts": 2}, {"distinct_parts": 1}, {"faces": 35}, {"vertices": 23}):
        with pytest.raises(MeshTooComplexError, match="limit"):
            parts_of(objects, items, **fewer)
    with pytest.raises(NoTrianglesError):
        parts_of(objects, [])
    with pytest.raises(MalformedMeshError, match="a part of itself"):
        parts_of(thing(1, components((1, None))), items)
    line = mesh([(n, 0.0, 0.0) for n in range(8)])
    with pytest.raises(DegenerateMeshError, match="'line'"):
        parts_of(thing(1) + thing(2, line, name="line"), items)
