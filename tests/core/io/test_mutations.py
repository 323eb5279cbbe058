"""Whatever happens to the bytes of a file: a valid mesh or a mesh error, and nothing else."""

import zipfile

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from core.errors import MeshError
from core.io import Limits, read_mesh, write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import CUBE, PLAIN, SQUARES, binary_ply, glb, obj, off, ply, stl
from tests.core.io.threemf_files import package

SPHERE = trimesh.creation.icosphere(subdivisions=1)
MESH = Mesh(SPHERE.vertices, SPHERE.faces)
# What a search should meet often: words, separators, and the edges of numbers.
TOKENS = [
    b"\n",
    b" ",
    b"\0",
    b"-",
    b"nan",
    b"1e999",
    b"4294967295",
    b"/",
    b"#",
    b"\\\n",
    b"[",
    b"}",
    b'"',
    b"solid",
    b"f ",
]
SEEDS = {
    "3mf": (package(), "3mf"),
    "3mf that is not compressed": (package(method=zipfile.ZIP_STORED), "3mf"),
    **{f"{name} written here": (write_mesh(MESH, name), name) for name in PLAIN},
    "stl in text": (stl(SPHERE.triangles[:12]), "stl"),
    "obj of squares": (obj(), "obj"),
    "obj of trimesh": (trimesh.creation.box().export(file_type="obj", include_normals=True).encode(), "obj"),
    "off of squares": (off(), "off"),
    "ply in text": (ply(), "ply"),
    "ply of mixed polygons": (binary_ply(CUBE, [*SQUARES, [0, 1, 2]]), "ply"),
    "glb of two nodes": (
        glb(nodes=[{"children": [1], "scale": [1, 2, 3]}, {"mesh": 0, "translation": [1, 0, 0]}]),
        "glb",
    ),
}  # fmt: skip
# Small, so that whatever passes is quick to read.
LIMITS = Limits(vertices=5_000, faces=5_000, parts=50)


def is_mesh_or_mesh_error(data, format):
    try:
        mesh = read_mesh(data, format, limits=LIMITS)
    except MeshError as error:
        message = str(error)
        assert message
        assert not any(sign in message for sign in ("Error", "array(", "site-packages", "\n"))
    else:
        assert np.isfinite(mesh.vertices).all()
        assert mesh.faces.min() >= 0
        assert mesh.faces.max() < len(mesh.vertices)
        assert len(mesh.faces) <= LIMITS.faces
        assert len(mesh.vertices) <= (LIMITS.vertices if format != "stl" else 3 * LIMITS.faces)


@pytest.mark.parametrize("seed", SEEDS)
class TestEverySeed:
    def test_is_sound(self, seed):
        read_mesh(*SEEDS[seed], limits=LIMITS)

    @settings(max_examples=40, derandomize=True, deadline=None)
    @given(data=st.data())
    def test_cut(self, seed, data):
        sound, format = SEEDS[seed]
        start = data.draw(st.integers(0, len(sound)) | st.just(0))
        end = data.draw(st.integers(start, len(sound)))
        is_mesh_or_mesh_error(sound[start:end], format)

    @settings(max_examples=120, derandomize=True, deadline=None)
    @given(data=st.data())
    def test_changed(self, seed, data):
        sound, format = SEEDS[seed]
        changed = bytearray(sound)
        for _ in range(data.draw(st.integers(1, 4))):
            # The head of a file decides most, so that half of the changes are there.
            place = data.draw(st.integers(0, len(changed)) | st.integers(0, min(400, len(changed))))
            length = data.draw(st.integers(0, 8))
            changed[place : place + length] = data.draw(st.sampled_from(TOKENS) | st.binary(max_size=8))
        is_mesh_or_mesh_error(bytes(changed), format)

    @settings(max_examples=15, derandomize=True, deadline=None)
    @given(format=st.sampled_from(PLAIN))
    def test_under_any_name(self, seed, format):
        is_mesh_or_mesh_error(SEEDS[seed][0], format)


@settings(max_examples=300, derandomize=True, deadline=None)
@given(data=st.binary(max_size=300), format=st.sampled_from(PLAIN))
def test_any_bytes(data, format):
    is_mesh_or_mesh_error(data, format)
