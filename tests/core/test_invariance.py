"""A shape is itself however it is placed, scaled or listed; and a comparison does not know who came first."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from core.embedding import Embedding
from core.gallery import make_shape
from core.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.records import embedding_to_bytes

SHAPES = (("person", 0), ("person", 1), ("octopus", 0), ("cup", 0), ("chair", 0), ("snake", 1))
PIPELINE = Pipeline(DEFAULT)


def rotated(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices @ Rotation.random(random_state=3).as_matrix().T, mesh.faces)


def translated(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices + np.array([3.0, -40.0, 7.0]), mesh.faces)


def scaled(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices * 0.0254, mesh.faces)


def vertices_shuffled(mesh: Mesh) -> Mesh:
    order = np.random.default_rng(1).permutation(len(mesh.vertices))
    return Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces])


def faces_shuffled(mesh: Mesh) -> Mesh:
    random = np.random.default_rng(2)
    faces = mesh.faces[random.permutation(len(mesh.faces))]
    turns = (random.integers(3, size=len(faces))[:, None] + np.arange(3)) % 3
    return Mesh(mesh.vertices, np.take_along_axis(faces, turns, axis=1))


@pytest.fixture(scope="module")
def meshes() -> list[Mesh]:
    return [make_shape(label, pose) for label, pose in SHAPES]


@pytest.fixture(scope="module")
def stored(meshes: list[Mesh]) -> list[Embedding]:
    return [PIPELINE.embed(mesh) for mesh in meshes]


def neighbours(cc: NDArray[np.float64]) -> list[int]:
    return np.argsort(-cc, kind="stable").tolist()


@pytest.mark.parametrize("change", [rotated, translated, scaled, vertices_shuffled, faces_shuffled])
@pytest.mark.parametrize("which", [0, 2, 3])
def test_a_changed_copy_has_the_same_neighbours(change, which, meshes, stored) -> None:
    before = PIPELINE.score(stored[which], stored).cc
    after = PIPELINE.score(PIPELINE.embed(change(meshes[which])), stored).cc
    assert np.abs(after - before).max() <= 0.01
    assert neighbours(after) == neighbours(before)


def test_scores_do_not_know_which_shape_came_first(stored) -> None:
    for i, first in enumerate(stored):
        there = PIPELINE.score(first, stored)
        back = [PIPELINE.score(second, [first]) for second in stored]
        assert np.abs(there.cc - [scores.cc[0] for scores in back]).max() <= 1e-9
        assert np.abs(there.ssd - [scores.ssd[0] for scores in back]).max() <= 1e-9
        assert np.abs(there.sim - [scores.sim[0] for scores in back]).max() <= 1e-9
        assert there.cc[i] == pytest.approx(1.0, abs=1e-6)
        assert there.ssd[i] == pytest.approx(0.0, abs=1e-6)
        assert there.sim[i] == pytest.approx(1.0, abs=1e-6)


def test_another_process_makes_the_same_bytes(stored) -> None:
    label, pose = SHAPES[2]
    program = (
        "import hashlib; from core.gallery import make_shape; from core.parameters import DEFAULT;"
        "from core.pipeline import Pipeline; from core.records import embedding_to_bytes;"
        f"mesh = make_shape({label!r}, {pose});"
        "print(hashlib.sha256(embedding_to_bytes(Pipeline(DEFAULT).embed(mesh))).hexdigest())"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert told.strip() == hashlib.sha256(embedding_to_bytes(stored[2])).hexdigest()
