"""The nearest vertices are those of a plain search, on either side of the limit of the tree."""

import numpy as np
import pytest

from core.mesh import preparation as module
from core.mesh.preparation import nearest_vertices


@pytest.mark.parametrize("most", [0, 10_000])
def test_nearest_vertices_are_those_of_least_distance(most, monkeypatch):
    monkeypatch.setattr(module, "MOST_IN_TREE", most)
    rng = np.random.default_rng(0)
    vertices, points = rng.normal(size=(3000, 3)), rng.normal(size=(70, 3))
    expected = np.linalg.norm(points[:, None] - vertices, axis=2).argmin(axis=1)
    assert nearest_vertices(vertices, points).tolist() == expected.tolist()


def test_the_first_of_coincident_vertices_is_taken_in_a_large_mesh(monkeypatch):
    monkeypatch.setattr(module, "MOST_IN_TREE", 0)
    points = np.random.default_rng(1).normal(size=(40, 3))
    assert nearest_vertices(np.tile(points, (3, 1)), points).tolist() == list(range(40))
