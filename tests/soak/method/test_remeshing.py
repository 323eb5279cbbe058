"""A shape of any class that is meshed anew finds itself first among the poses of its class."""

import fast_simplification
import numpy as np
import pytest
import trimesh

from core.gallery import CLASSES, make_shape
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline

POSES = 8


def subdivided(mesh):
    return Mesh(*trimesh.remesh.subdivide(mesh.vertices, mesh.faces))


def halved(mesh):
    points, faces = fast_simplification.simplify(
        mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), target_reduction=0.5
    )
    return Mesh(points.astype(np.float64), faces.astype(np.int64))


@pytest.mark.parametrize("label", CLASSES)
def test_four_faces_for_each_or_half_of_them_find_the_original(label):
    """Two poses, subdivided and halved, find themselves among eight poses of their body class."""
    pipeline = Pipeline(DEFAULT)
    stored = [pipeline.embed(make_shape(label, pose)) for pose in range(POSES)]
    for pose in (0, 3):
        for change in (subdivided, halved):
            scores = pipeline.score(pipeline.embed(change(make_shape(label, pose))), stored)
            assert scores.cc.argmax() == pose, change.__name__
            assert scores.cc[pose] > 0.99
