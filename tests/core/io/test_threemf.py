"""3MF: units, places, parts and written files, and what is wrong."""

import io
import tracemalloc
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

from core.errors import (
    DegenerateMeshError,
    ExternalReferenceError,
    MalformedMeshError,
    MeshError,
    MeshTooComplexError,
    NonFiniteCoordinatesError,
    NoTrianglesError,
)
from core.io import Limits, read_file, read_mesh, read_parts, threemf_model, write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import CUBE, TRIANGLES, faulty
from tests.core.io.threemf_files import (
    BEAMS,
    CORE,
    MALFORMED,
    MODEL,
    MOVED,
    OTHER,
    RELS,
    components,
    mesh,
    model,
    nested,
    package,
    thing,
    with_coordinate,
)
from tests.core.shapes import volume

CORNERS = np.asarray(CUBE, dtype=float)[np.asarray(TRIANGLES)]
AWAY = np.array([10, 20, 30])
# x becomes y, y becomes -x: rows are multiplied from the left.
TURNED = "0 1 0 -1 0 0 0 0 1 0 0 0"
DRAFT = "http://schemas.microsoft.com/3dmanufacturing/2013/01"
MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"


def turned(corners):
    return np.stack([-corners[..., 1], corners[..., 0], corners[..., 2]], axis=-1)


def corners(data, **limits):
    read = read_mesh(data, "3mf", limits=Limits(**limits))
    return read.vertices[read.faces]


CUBES = {
    "plain": package(),
    "stored": package(method=zipfile.ZIP_STORED),
    "no unit said": package(model(head="")),
    "in UTF-16": package(model().replace("UTF-8", "UTF-16").encode("utf-16")),
    "a picture beside it": package(parts={"Metadata/thumbnail.png": b"\x89PNG"}),
    "another case of letters": package(rels=RELS.replace("/3D/3dmodel", "3d/3DMODEL")),
    "an object that is not built": package(model(thing(1) + thing(2))),
    "production required": package(model(head='requiredextensions="p"')),
    "materials required": package(model(head=f'xmlns:m="{MATERIAL}" requiredextensions="m p"')),
    "beams not required": package(model(head=f'xmlns:b="{BEAMS}"')),
    "support left out": package(model(thing(1) + thing(2, type="support"), [(1, None), (2, MOVED)])),
    "no relationships": package(parts={"_rels/.rels": None}),
    "no model named": package(rels=RELS.replace("3dmodel", "4dmodel", 1)),
    "the model named not there": package(rels=RELS.replace("/3D/3dmodel", "/3D/2dmodel")),
    "a path out of the package": package(rels=RELS.replace("/3D/3dmodel.model", "../../etc/passwd")),
    "in a folder": package(parts={"3D/3dmodel.model": None, "cube/3D/3dmodel.model": model()}),
    "backslashes": package(parts={"3D/3dmodel.model": None, "3D\\3dmodel.model": model()}),
    "the namespace of the drafts": package(model().replace(CORE, DRAFT)),
    "a path with %20": package(
        model(thing(2, components((1, None, "/3D/a%20b.model"))), [(2, None)]),
        {"3D/a b.model": model(items=())},
    ),
    "a helper left out": package(
        model(thing(1) + thing(2, type="other") + thing(3, components((1, None), (2, None))), [(3, None)])
    ),
}


@pytest.mark.parametrize("data", CUBES.values(), ids=CUBES)
def test_a_cube(data):
    assert np.array_equal(corners(data), CORNERS)


@pytest.mark.parametrize(
    ("unit", "size"),
    [
        ("micron", 1e-3),
        ("millimeter", 1),
        ("centimeter", 10),
        ("inch", 25.4),
        ("foot", 304.8),
        ("meter", 1e3),
    ],
)
def test_every_unit_is_read_in_millimetres(unit, size):
    placed = package(model(items=[(1, MOVED)], head=f'unit="{unit}"'))
    assert corners(placed) == pytest.approx((CORNERS + AWAY) * size)


def test_the_build_places_an_object_wherever_it_says():
    found = corners(package(model(items=[(1, None), (1, MOVED), (1, TURNED)])))
    assert np.array_equal(found, np.concatenate([CORNERS, CORNERS + AWAY, turned(CORNERS)]))


def test_components_are_placed_in_what_they_are_components_of():
    objects = thing(1) + thing(2, components((1, MOVED), (1, None))) + thing(3, components((2, TURNED)))
    found = corners(package(model(objects, [(3, "2 0 0 0 2 0 0 0 2 0 0 0")])))
    assert np.array_equal(found, np.concatenate([2 * turned(CORNERS + AWAY), 2 * turned(CORNERS)]))


def test_a_mirrored_object_keeps_its_inside():
    mirrored = read_mesh(package(model(items=[(1, "-1 0 0 0 1 0 0 0 1 0 0 0")])), "3mf")
    assert volume(mirrored) == pytest.approx(1.0)


def test_parts_in_other_files_of_the_package():
    """As slicers write them, with the production extension."""
    other = model(thing(7) + thing(8, components((7, MOVED))), ())
    root = model(
        thing(1, components((8, None, OTHER), (7, TURNED, OTHER))), [(1, None), (7, None, OTHER.upper())]
    )
    found = corners(package(root, {OTHER[1:]: other}))
    assert np.array_equal(found, np.concatenate([CORNERS + AWAY, turned(CORNERS), CORNERS]))


def test_blocks_join_where_they_should(monkeypatch):
    """More rows than are taken at a time."""
    monkeypatch.setattr("core.io.threemf_model._BLOCK", 64)
    rng = np.random.default_rng(1)
    vertices = rng.normal(size=(200, 3)).round(3)
    faces = rng.integers(0, 200, size=(201, 3))
    assert np.array_equal(corners(package(model(thing(1, mesh(vertices, faces))))), vertices[faces])


def test_limits_count_every_place():
    data = package(model(items=[(1, None)] * 5))
    assert len(corners(data, parts=5, faces=60, vertices=40)) == 60
    for fewer in ({"parts": 4}, {"faces": 59}, {"vertices": 39}):
        with pytest.raises(MeshTooComplexError, match="limit"):
            corners(data, **fewer)


REFUSED = {
    MalformedMeshError: MALFORMED,
    NoTrianglesError: {
        "no build and no object": package(model("", ())),
        "no build and nothing but support": package(model(thing(1, type="support"), ())),
        "no faces": package(model(thing(1, mesh(faces=())))),
        "nothing but support": package(model(thing(1, type="support"))),
    },
    NonFiniteCoordinatesError: {
        "NaN": with_coordinate("NaN"),
        "infinity": with_coordinate("inf"),
        "past the largest number": with_coordinate("1e999"),
        "a transform of NaN": package(model(items=[(1, MOVED.replace("10", "nan"))])),
        "scaled past the largest": package(
            model(items=[(1, "1e300 0 0 0 1 0 0 0 1 1e308 0 0")], head='unit="meter"')
        ),
    },
    DegenerateMeshError: {
        "scaled to nothing": package(model(items=[(1, "0 0 0 0 0 0 0 0 0 0 0 0")])),
        "one point": package(model(thing(1, mesh(np.ones((8, 3)))))),
    },
    ExternalReferenceError: {
        "a model elsewhere": package(rels=RELS.replace('Target="/', 'TargetMode="External" Target="file:///'))
    },
    MeshTooComplexError: {
        "components of components": package(model(nested(12), [(12, None)])),
        "empty components of components": package(
            model(nested(12).replace(mesh(), "<components/>"), [(12, None)])
        ),
        "elements inside each other": package(model("<a>" * 1_000 + "</a>" * 1_000)),
    },
}


@faulty(REFUSED)
def test_a_faulty_file_is_refused_by_its_cause(data, error):
    with pytest.raises(error) as caught:
        read_mesh(data, "3mf")
    assert type(caught.value) is error
    assert "passwd" not in str(caught.value)


# Made by their tests: all of them take seconds.
TOO_LARGE = {
    "100,000 items": lambda: package(model(items=[(1, None)] * 100_000)),
    "100,000 components": lambda: package(
        model(thing(1) + thing(2, components(*[(1, None)] * 100_000)), [(2, None)])
    ),
    "100,000 objects": lambda: package(model("".join(thing(n, "") for n in range(100_000)), [(0, None)])),
    "100,000 members": lambda: package(parts={f"{number}": "" for number in range(100_000)}),
    "a comment of 30 MB": lambda: package(model(f"<!--{'x' * 30_000_000}-->")),
    "an attribute of 30 MB": lambda: package(model(head=f'unit="{"x" * 30_000_000}"')),
}


@pytest.mark.parametrize("made", TOO_LARGE.values(), ids=TOO_LARGE)
def test_a_file_of_too_much_is_refused(made):
    with pytest.raises(MeshTooComplexError):
        read_mesh(made(), "3mf")


def test_messages():
    for data, words in (
        (MALFORMED["an unknown extension"], "beam lattice"),
        (MALFORMED["billion laughs"], "document type"),
        (MALFORMED["index too large"], "vertex 8"),
        (MALFORMED["a circle"], "part of itself"),
        (MALFORMED["a ZIP of nothing"], "which of its parts"),
        (package(model().replace("<item ", '<item q:UUID="1" ')), "a prefix that it does not declare"),
    ):
        with pytest.raises(MeshError, match=words):
            read_mesh(data, "3mf")


def test_a_build_without_items_places_every_object_that_is_no_component():
    objects = thing(1) + thing(2, components((1, MOVED), (1, None))) + thing(3, type="support")
    file = read_file(package(model(objects, ())), "3mf")
    assert np.array_equal(file.mesh.vertices, np.concatenate([CUBE + np.array([10, 20, 30]), CUBE]))
    assert file.warnings == ("the build of the 3MF is empty: all of its objects are read",)


def test_components_are_counted_as_they_come(monkeypatch):
    """Those of one model, and those of many."""
    read, matrix = [], threemf_model._matrix
    monkeypatch.setattr(threemf_model, "_matrix", lambda text: read.append(text) or matrix(text))
    many = components(*[(1, None)] * 1_000)
    others = {
        f"3D/{n}.model": model(thing(1) + thing(2, components(*[(1, None)] * 60)), ()) for n in range(9)
    }
    for data in (
        package(model(thing(1) + thing(2, many), [(2, None)])),
        package(model(items=[(2, None, f"/3D/{n}.model") for n in range(9)]), others),
    ):
        read.clear()
        with pytest.raises(MeshTooComplexError, match="components; the limit is 160"):
            read_mesh(data, "3mf", limits=Limits(parts=10))
        assert len(read) <= 230


def test_a_bomb_is_refused_by_its_size_and_takes_no_memory():
    bomb = package(" " * 50_000_000)
    assert len(bomb) < 100_000
    tracemalloc.start()
    with pytest.raises(MeshTooComplexError, match="unpacks to 50000000 bytes"):
        read_mesh(bomb, "3mf", limits=Limits(vertices=1_000, faces=1_000))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1_000_000


def test_a_part_is_unpacked_piece_by_piece():
    data = package(model(thing(1) + " " * 50_000_000))
    tracemalloc.start()
    assert np.array_equal(corners(data), CORNERS)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 10_000_000


FULL = np.array([[0.1, 1e-300, -0.0], [1 / 3, -1.2345678901234567e20, 5e-324], [2.0**60 + 256, 1e16, 7.0]])


def bumpy(count):
    rng = np.random.default_rng(4)
    return Mesh(
        rng.normal(size=(count, 3)), np.sort(rng.permuted(np.tile(np.arange(count), (9, 1)), axis=1)[:, :3])
    )


def parts(data):
    with zipfile.ZipFile(io.BytesIO(data)) as package:
        assert package.testzip() is None
        return {name: ElementTree.fromstring(package.read(name)) for name in package.namelist()}


@pytest.mark.parametrize(
    "mesh",
    [Mesh(CUBE, TRIANGLES), Mesh(FULL, [[0, 1, 2], [2, 1, 0]]), bumpy(50)],
    ids=["cube", "every kind of number", "bumpy"],
)
def test_a_mesh_is_read_back_exactly(mesh):
    again = read_mesh(write_mesh(mesh, "3MF"), "3mf")
    assert len(again.vertices) == len(mesh.vertices)
    assert np.array_equal(again.vertices[again.faces], mesh.vertices[mesh.faces])
    assert np.array_equal(again.faces, mesh.faces)


def test_the_package_is_as_the_format_says():
    inside = parts(write_mesh(Mesh(CUBE, TRIANGLES), "3mf"))
    assert list(inside) == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
    kinds = {each.get("Extension") for each in inside["[Content_Types].xml"]}
    assert kinds == {"rels", "model"}
    (start,) = inside["_rels/.rels"]
    assert (start.get("Type"), start.get("Target")) == (MODEL, "/3D/3dmodel.model")
    model = inside["3D/3dmodel.model"]
    assert (model.tag, model.get("unit")) == (f"{{{CORE}}}model", "millimeter")
    (thing,) = model.findall(f"{{{CORE}}}resources/{{{CORE}}}object")
    (item,) = model.findall(f"{{{CORE}}}build/{{{CORE}}}item")
    assert (item.get("objectid"), item.get("transform")) == (thing.get("id"), None)
    vertices = [[float(each.get(axis)) for axis in "xyz"] for each in thing.iter(f"{{{CORE}}}vertex")]
    faces = [
        [int(each.get(name)) for name in ("v1", "v2", "v3")] for each in thing.iter(f"{{{CORE}}}triangle")
    ]
    assert np.array_equal(vertices, CUBE)
    assert np.array_equal(faces, TRIANGLES)


def test_the_same_mesh_gives_the_same_bytes_whenever_and_wherever():
    data = write_mesh(bumpy(50), "3mf")
    assert data == write_mesh(bumpy(50), "3mf")
    with zipfile.ZipFile(io.BytesIO(data)) as package:
        assert {member.date_time for member in package.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert {member.create_system for member in package.infolist()} == {3}


def test_a_face_that_names_a_vertex_twice_is_left_out():
    spoilt = np.vstack([[[0, 0, 1]], TRIANGLES, [[2, 3, 2], [4, 5, 5], [6, 6, 6]]])
    assert write_mesh(Mesh(CUBE, spoilt), "3mf") == write_mesh(Mesh(CUBE, TRIANGLES), "3mf")
    with pytest.raises(NoTrianglesError, match="twice"):
        write_mesh(Mesh(CUBE, spoilt[-3:]), "3mf")


TURNED_AND_RAISED = "0 1 0 -1 0 0 0 0 1 5 0 0"
SLIGHTLY = "0.866025 0.5 0 -0.5 0.866025 0 0 0 1 0 0 0"
DOUBLED = "2 0 0 0 2 0 0 0 2 0 0 0"
DOUBLED_AND_TURNED = "0 2 0 -2 0 0 0 0 2 1 1 1"
MIRRORED = "-1 0 0 0 1 0 0 0 1 0 0 0"
HALF = mesh(np.asarray(CUBE) / 2)


def parts_of(objects, items, **limits):
    found = read_parts(package(model(objects, items)), "3mf", limits=Limits(**limits))
    return [(part.name, part.path, part.instances) for part in found]


def test_each_object_is_a_part_with_its_instances():
    objects = (
        thing(1, name="pin")
        + thing(2, HALF, name="cap")
        + thing(3, components((1, None), (1, MOVED), (2, TURNED_AND_RAISED)), name="bearing")
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


def test_the_parts_have_the_volume_of_the_whole():
    objects = thing(1) + thing(2, HALF) + thing(3, components((1, SLIGHTLY), (2, "3 0 0 1 1 0 0 0 -2 7 7 7")))
    data = package(model(objects, [(3, DOUBLED_AND_TURNED), (3, None), (2, MIRRORED)]))
    parts = read_parts(data, "3mf")
    assert sum(part.instances for part in parts) == 5
    total = sum(part.instances * volume(part.mesh) for part in parts)
    assert total == pytest.approx(volume(read_mesh(data, "3mf")), rel=1e-5)


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
    assert parts_of(objects, []) == parts_of(objects, items[:2])
    with pytest.raises(MalformedMeshError, match="a part of itself"):
        parts_of(thing(1, components((1, None))), items)
    line = mesh([(n, 0.0, 0.0) for n in range(8)])
    with pytest.raises(DegenerateMeshError, match="'line'"):
        parts_of(thing(1) + thing(2, line, name="line"), items)
