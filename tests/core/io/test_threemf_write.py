"""3MF as it is written: read back here, and by what the standard library reads."""

import io
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

from core.errors import NoTrianglesError
from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import CUBE, TRIANGLES
from tests.core.io.threemf_files import CORE, MODEL

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
    assert np.array_equal(again.vertices, mesh.vertices)
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
