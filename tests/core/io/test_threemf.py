"""3MF: units, places and parts, and what is wrong."""

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
from core.io import Limits, read_mesh
from tests.core.io.files import CUBE, TRIANGLES
from tests.core.io.threemf_faults import BEAMS, MALFORMED, MOVED, OTHER, nested, with_coordinate
from tests.core.io.threemf_files import RELS, components, mesh, model, package, thing

CORNERS = np.asarray(CUBE, dtype=float)[np.asarray(TRIANGLES)]
AWAY = np.array([10, 20, 30])
# x becomes y, y becomes -x: rows are multiplied from the left.
TURNED = "0 1 0 -1 0 0 0 0 1 0 0 0"
MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"


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
def test_a_faulty_file_is_refused_by_its_cause(name):
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
