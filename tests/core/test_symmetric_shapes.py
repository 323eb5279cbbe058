"""Shapes full of ties: equal distances, equal axes and equal eigenvalues, which rounding must not decide."""

from functools import cache

import numpy as np
import pytest
import trimesh

from core.gallery import make_shape
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from tests.core.shapes import SAME_SHAPE, box, icosphere, joined, loose_parts, mesh_of, rectangle, shifted

SETTINGS = {"default": DEFAULT, "paper": PAPER}
DRIFT = 0.01

SHAPES = {
    "cube": box(1, 1, 1),
    "square bar": box(3, 1, 1),
    "bar": box(3, 2, 1),
    "triangle": Mesh([[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 1, 2]]),
    "sheet": rectangle(3, 2, 24, 16),
    "sphere": icosphere(3),
    "cylinder": mesh_of(trimesh.creation.cylinder(radius=1.0, height=3.0, sections=32)),
    "cone": mesh_of(trimesh.creation.cone(radius=1.0, height=2.0)),
    "ring": mesh_of(trimesh.creation.torus(major_radius=2.0, minor_radius=0.6)),
    "table": loose_parts(),
    "dumbbell": joined(shifted(icosphere(2), (2, 0, 0)), shifted(icosphere(2), (-2, 0, 0))),
}
OTHERS = ["cup", "fish"]


@cache
def stored(setting):
    pipeline = Pipeline(SETTINGS[setting])
    meshes = [*SHAPES.values(), *(make_shape(label, 0) for label in OTHERS)]
    return pipeline, [pipeline.embed(mesh) for mesh in meshes]


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("name", SHAPES)
def test_a_symmetric_shape_given_otherwise_has_the_same_neighbours(name, setting):
    pipeline, embeddings = stored(setting)
    place = list(SHAPES).index(name)
    expected = pipeline.score(embeddings[place], embeddings).cc
    for change in ("turned", "vertices shuffled", "all of these"):
        found = pipeline.embed(SAME_SHAPE[change](SHAPES[name]))
        cc = pipeline.score(found, embeddings).cc
        assert np.abs(cc - expected).max() <= DRIFT, change
        assert (np.argsort(-cc)[:3] == np.argsort(-expected)[:3]).all(), change
        np.testing.assert_allclose(found.signature, embeddings[place].signature, atol=1e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_nor_does_rounding_to_single_precision(name):
    pipeline, embeddings = stored("default")
    place = list(SHAPES).index(name)
    turned = SAME_SHAPE["turned"](SHAPES[name])
    rounded = pipeline.embed(Mesh(turned.vertices.astype(np.float32), turned.faces))
    assert pipeline.match(rounded, embeddings[place]).cc >= 1.0 - DRIFT
