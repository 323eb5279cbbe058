"""3MF: units, places and parts, and what is wrong."""

import struct
import tracemalloc
import zipfile

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
from core.reading import Limits, read_mesh
from tests.core.files import CUBE, TRIANGLES
from tests.core.threemf_files import RELS, components, mesh, model, package, thing

CORNERS = np.asarray(CUBE, dtype=float)[np.asarray(TRIANGLES)]
AWAY = np.array([10, 20, 30])
MOVED = "1 0 0 0 1 0 0 0 1 10 20 30"
# x becomes y, y becomes -x: rows are multiplied from the left.
TURNED = "0 1 0 -1 0 0 0 0 1 0 0 0"
OTHER = "/3D/Objects/other.model"
MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"


def corners(data, **limits):
    read = read_mesh(data, "3mf", limits=Limits(**limits))
    return read.vertices[read.faces]


def volume(found):
    return float(np.einsum("ij,ij->i", found[:, 0], np.cross(found[:, 1], found[:, 2])).sum() / 6)


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(package(), id="plain"),
        pytest.param(package(method=zipfile.ZIP_STORED), id="stored"),
        pytest.param(package(model(head="")), id="no unit said"),
        pytest.param(package(model().replace("UTF-8", "UTF-16").encode("utf-16")), id="in UTF-16"),
        pytest.param(package(parts={"Metadata/thumbnail.png": b"\x89PNG"}), id="a picture beside it"),
        pytest.param(package(rels=RELS.replace("/3D/3dmodel", "3d/3DMODEL")), id="another case of letters"),
        pytest.param(package(model(thing(1) + thing(2))), id="an object that is not built"),
        pytest.param(package(model(head='requiredextensions="p"')), id="production required"),
        pytest.param(
            package(model(head=f'xmlns:m="{MATERIAL}" requiredextensions="m p"')), id="materials required"
        ),
        pytest.param(package(model(head=f'xmlns:b="{BEAMS}"')), id="beams not required"),
        pytest.param(
            package(model(thing(1) + thing(2, type="support"), [(1, None), (2, MOVED)])),
            id="support left out",
        ),
        pytest.param(
            package(
                model(
                    thing(1) + thing(2, type="other") + thing(3, components((1, None), (2, None))),
                    [(3, None)],
                )
            ),
            id="a helper left out",
        ),
    ],
)  # fmt: skip
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


def test_coordinates_keep_every_digit():
    vertices = np.random.default_rng(0).normal(size=(8, 3)) * 1e5
    found = corners(package(model(thing(1, mesh(vertices)))))
    assert np.array_equal(found, vertices[np.asarray(TRIANGLES)])


def test_the_build_places_an_object_wherever_it_says():
    found = corners(package(model(items=[(1, None), (1, MOVED), (1, TURNED)])))
    turned = np.stack([-CORNERS[..., 1], CORNERS[..., 0], CORNERS[..., 2]], axis=-1)
    assert np.array_equal(found, np.concatenate([CORNERS, CORNERS + AWAY, turned]))


def test_components_are_placed_in_what_they_are_components_of():
    objects = thing(1) + thing(2, components((1, MOVED), (1, None))) + thing(3, components((2, TURNED)))
    found = corners(package(model(objects, [(3, "2 0 0 0 2 0 0 0 2 0 0 0")])))
    moved = CORNERS + AWAY
    expected = np.concatenate(
        [2 * np.stack([-c[..., 1], c[..., 0], c[..., 2]], axis=-1) for c in (moved, CORNERS)]
    )
    assert np.array_equal(found, expected)


def test_a_mirrored_object_keeps_its_inside():
    found = corners(package(model(items=[(1, "-1 0 0 0 1 0 0 0 1 0 0 0")])))
    assert volume(found) == pytest.approx(volume(CORNERS))


def test_parts_in_other_files_of_the_package():
    """As slicers write them, with the production extension."""
    other = model(thing(7) + thing(8, components((7, MOVED))), ())
    root = model(
        thing(1, components((8, None, OTHER), (7, TURNED, OTHER))), [(1, None), (7, None, OTHER.upper())]
    )
    found = corners(package(root, {OTHER[1:]: other}))
    turned = np.stack([-CORNERS[..., 1], CORNERS[..., 0], CORNERS[..., 2]], axis=-1)
    assert np.array_equal(found, np.concatenate([CORNERS + AWAY, turned, CORNERS]))


def test_blocks_join_where_they_should():
    """More rows than are taken at a time."""
    rng = np.random.default_rng(1)
    vertices = rng.normal(size=(70_000, 3)).round(3)
    faces = rng.integers(0, 70_000, size=(70_001, 3))
    assert np.array_equal(corners(package(model(thing(1, mesh(vertices, faces))))), vertices[faces])


def test_limits_count_every_place():
    data = package(model(items=[(1, None)] * 5))
    assert len(corners(data, parts=5, faces=60, vertices=40)) == 60
    for fewer in ({"parts": 4}, {"faces": 59}, {"vertices": 39}):
        with pytest.raises(MeshTooComplexError, match="limit"):
            corners(data, **fewer)


def entities(count):
    return "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(count))


LAUGHS = f'<!DOCTYPE model [<!ENTITY a "ha">{entities(9)}]>\n'
OUTSIDE = '<!DOCTYPE model [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n'
ELSEWHERE = '<!DOCTYPE model SYSTEM "http://127.0.0.1:1/x.dtd">\n'
SOUND = package()


def nested(levels, times=10):
    """Objects of objects: 10^levels places of a cube in a few lines."""
    return thing(0) + "".join(thing(n, components(*[(n - 1, None)] * times)) for n in range(1, levels + 1))


def with_corner(value):
    return package(model().replace('v1="0"', f'v1="{value}"', 1))


def with_coordinate(value):
    return package(model().replace('x="0.0"', f'x="{value}"', 1))


def declared(size):
    """The length of the model, said to be another in the directory and before the part."""
    place = SOUND.rindex(b"3D/3dmodel.model") - 46
    found = struct.unpack_from("<I", SOUND, place + 24)[0]
    return SOUND[: place + 24] + struct.pack("<I", size) + SOUND[place + 28 :], found


MALFORMED = {
    "not a ZIP": b"3D model",
    "a ZIP of nothing": package(None, {"3D/3dmodel.model": None, "_rels/.rels": None}),
    "no relationships": package(parts={"_rels/.rels": None}),
    "no model named": package(rels=RELS.replace("3dmodel", "4dmodel", 1)),
    "the model not there": package(rels=RELS.replace("/3D/3dmodel", "/3D/2dmodel")),
    "a path out of the package": package(rels=RELS.replace("/3D/3dmodel.model", "../../etc/passwd")),
    "billion laughs": package(model(before=LAUGHS).replace("millimeter", "&j;")),
    "an external entity": package(model(before=OUTSIDE).replace("</build>", "&e;</build>")),
    "a DTD elsewhere": package(model(before=ELSEWHERE)),
    "laughs in the relationships": package(rels=RELS.replace("<Rel", LAUGHS + "<Rel", 1)),
    "not XML": package("v 0 0 0\n"),
    "another document": package("<svg xmlns='http://www.w3.org/2000/svg'/>"),
    "another namespace": package(model().replace("core/2015/02", "core/2099/02")),
    "cut in the XML": package(model()[:-40]),
    "bytes that are no text": package(model().encode().replace(b"millimeter", b"\xff\xfe\xff")),
    "an unknown encoding": package(model().replace("UTF-8", "klingon")),
    "an unknown unit": package(model(head='unit="parsec"')),
    "an unknown extension": package(model(head=f'xmlns:b="{BEAMS}" requiredextensions="b"')),
    "an undeclared extension": package(model(head='requiredextensions="q"')),
    "index too large": with_corner(8),
    "a negative index": with_corner(-1),
    "an index of 4e9": with_corner(4_000_000_000),
    "an index of 1e30": with_corner("1" + "0" * 30),
    "half an index": with_corner(0.5),
    "no index": with_corner(""),
    "an index in words": with_corner("one"),
    "a coordinate in words": with_coordinate("one"),
    "a coordinate with an underscore": with_coordinate("1_0"),
    "a coordinate in other digits": with_coordinate("١"),
    "a vertex of two": package(model().replace(' z="0.0"', "", 1)),
    "a triangle of two": package(model().replace(' v3="', ' v4="', 1)),
    "a transform of eleven": package(model(items=[(1, "1 0 0 0 1 0 0 0 1 0 0")])),
    "a transform of words": package(model(items=[(1, "a b c d e f g h i j k l")])),
    "an object without an id": package(model().replace(' id="1"', "")),
    "one id twice": package(model(thing(1) + thing(1))),
    "no such object": package(model(items=[(2, None)])),
    "no such component": package(model(thing(1, components((9, None))))),
    "no such part": package(model(items=[(1, None, "/3D/none.model")])),
    "its own component": package(model(thing(1, components((1, None))))),
    "a circle": package(model(thing(1, components((2, None))) + thing(2, components((1, None))))),
    "a circle across parts": package(
        model(thing(1, components((2, None, OTHER)))),
        {OTHER[1:]: model(thing(2, components((1, None, "/3D/3dmodel.model"))), ())},
    ),
    "two units": package(
        model(items=[(7, None, OTHER)]), {OTHER[1:]: model(thing(7), (), head='unit="inch"')}
    ),
    "two parts of one name": package(parts={"3d/3DMODEL.model": model()}),
    "a damaged part": SOUND.replace(SOUND[300:310], bytes(10), 1),
    "no directory": SOUND[:-60],
    "shorter than it says": declared(10_000_000)[0],
    "longer than it says": declared(100)[0],
}  # fmt: skip
REFUSED = {
    **{name: (data, MalformedMeshError) for name, data in MALFORMED.items()},
    "no build": (package(model(items=())), NoTrianglesError),
    "no faces": (package(model(thing(1, mesh(faces=())))), NoTrianglesError),
    "nothing but support": (package(model(thing(1, type="support"))), NoTrianglesError),
    "NaN": (with_coordinate("NaN"), NonFiniteCoordinatesError),
    "infinity": (with_coordinate("inf"), NonFiniteCoordinatesError),
    "past the largest number": (with_coordinate("1e999"), NonFiniteCoordinatesError),
    "a transform of NaN": (
        package(model(items=[(1, MOVED.replace("10", "nan"))])),
        NonFiniteCoordinatesError,
    ),
    "scaled past the largest": (
        package(model(items=[(1, "1e300 0 0 0 1 0 0 0 1 1e308 0 0")], head='unit="meter"')),
        NonFiniteCoordinatesError,
    ),
    "scaled to nothing": (package(model(items=[(1, "0 0 0 0 0 0 0 0 0 0 0 0")])), DegenerateMeshError),
    "one point": (package(model(thing(1, mesh(np.ones((8, 3)))))), DegenerateMeshError),
    "a model elsewhere": (
        package(rels=RELS.replace('Target="/', 'TargetMode="External" Target="file:///')),
        ExternalReferenceError,
    ),
    "components of components": (package(model(nested(12), [(12, None)])), MeshTooComplexError),
    "empty components of components": (
        package(model(nested(12).replace(mesh(), "<components/>"), [(12, None)])),
        MeshTooComplexError,
    ),
    "100,000 items": (package(model(items=[(1, None)] * 100_000)), MeshTooComplexError),
    "100,000 objects": (
        package(model("".join(thing(n, "") for n in range(100_000)), [(0, None)])),
        MeshTooComplexError,
    ),
    "100,000 members": (
        package(parts={f"{number}": "" for number in range(100_000)}),
        MeshTooComplexError,
    ),
    "elements inside each other": (package(model("<a>" * 1_000 + "</a>" * 1_000)), MeshTooComplexError),
    "a comment of 30 MB": (package(model(f"<!--{'x' * 30_000_000}-->")), MeshTooComplexError),
    "an attribute of 30 MB": (package(model(head=f'unit="{"x" * 30_000_000}"')), MeshTooComplexError),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_refused_by_its_cause(name):
    data, error = REFUSED[name]
    with pytest.raises(error) as caught:
        read_mesh(data, "3mf")
    assert type(caught.value) is error
    assert "passwd" not in str(caught.value)


def test_messages():
    for data, words in (
        (MALFORMED["an unknown extension"], "extension b,"),
        (MALFORMED["billion laughs"], "document type"),
        (MALFORMED["index too large"], "vertex 8"),
        (MALFORMED["a circle"], "part of itself"),
        (MALFORMED["a ZIP of nothing"], "not there"),
    ):
        with pytest.raises(MeshError, match=words):
            read_mesh(data, "3mf")


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
