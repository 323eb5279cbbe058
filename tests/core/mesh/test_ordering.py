"""The order of the vertices that the shape itself gives."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.mesh.ordering import independent_weights, tied_ranks
from tests.core.shapes import (
    MANY_KINDS,
    area,
    areas,
    blob,
    box,
    faces_shuffled,
    icosphere,
    joined,
    loose_parts,
    rectangle,
    shifted,
    soup,
    turned,
    vertices_shuffled,
)

SHAPES = {
    "blob": blob(subdivisions=2),
    "cube": box(1, 1, 1),
    "square bar": box(3, 1, 1),
    "bar": box(3, 2, 1),
    "sphere": icosphere(2),
    "sheet": rectangle(3, 2, 9, 6),
    "square sheet": rectangle(2, 2, 4, 4),
    "table": loose_parts(),
    "six equal balls": joined(
        *(shifted(icosphere(1), 3 * side * np.eye(3)[axis]) for axis in range(3) for side in (-1, 1))
    ),
    "soup": soup(icosphere(1)),
    "chair": MANY_KINDS["chair"](),
}


def corners(mesh):
    return sorted(map(sorted, mesh.faces.tolist()))


def changed(mesh, seed):
    return shifted(turned(faces_shuffled(vertices_shuffled(mesh, seed), seed), seed), (1, 2, 3))


@pytest.mark.parametrize("mesh", SHAPES.values(), ids=SHAPES)
def test_vertices_and_faces_come_in_one_order_up_to_a_symmetry_of_the_mesh(mesh):
    # Equal distances between all vertices, taken in order, and equal faces: the two differ by a congruence.
    expected = clean(mesh).mesh
    for seed in range(4):
        found = clean(changed(mesh, seed)).mesh
        difference = cdist(found.vertices, found.vertices) - cdist(expected.vertices, expected.vertices)
        assert np.abs(difference).max() < 1e-9 * np.ptp(mesh.vertices)
        assert corners(found) == corners(expected)


@pytest.mark.parametrize("name", ["cube", "bar", "sheet", "table"])
def test_rounding_to_single_precision_does_not_change_it(name):
    expected = clean(SHAPES[name]).mesh
    for seed in range(4):
        mesh = changed(SHAPES[name], seed)
        found = clean(Mesh(mesh.vertices.astype(np.float32), mesh.faces)).mesh
        difference = cdist(found.vertices, found.vertices) - cdist(expected.vertices, expected.vertices)
        assert np.abs(difference).max() < 1e-5


def test_without_symmetry_it_is_the_order_by_distance_from_the_centroid():
    mesh = clean(blob()).mesh
    centre = areas(mesh) @ mesh.vertices[mesh.faces].mean(axis=1) / area(mesh)
    distances = np.linalg.norm(mesh.vertices - centre, axis=1)
    assert (np.diff(distances) > -1e-4).all()


def test_settled_values_share_a_rank_where_only_rounding_parts_them():
    assert tied_ranks(np.array([3.0, 1.0, 3.0 + 1e-9, 2.0, 1.0 - 1e-9])).tolist() == [2, 0, 2, 1, 0]
    assert tied_ranks(np.array([])).tolist() == []


def test_sums_of_the_weights_of_different_ranks_differ():
    weights = independent_weights(np.arange(300))
    sums = np.sort((weights[:, None] + weights[None, :])[np.triu_indices(300)])
    assert np.diff(sums).min() > 1e-12
