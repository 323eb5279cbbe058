"""Marching cubes: a ball's volume, and closed surfaces from every case of a cube."""

import numpy as np
import pytest

from core.gallery.marching_cubes import marching_cubes
from core.gallery.surface import genus
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from tests.core.shapes import volume


def test_a_ball_has_its_volume_and_its_normals_point_outward() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(40.0)] * 3, indexing="ij"), axis=-1)
    vertices, faces = marching_cubes(np.linalg.norm(grid - [19.3, 19.6, 20.1], axis=-1) - 15.0)
    assert volume(Mesh(vertices, faces)) == pytest.approx(4.0 / 3.0 * np.pi * 15.0**3, rel=5e-3)
    assert np.linalg.norm(vertices - [19.3, 19.6, 20.1], axis=1) == pytest.approx(15.0, abs=0.02)


def test_values_of_any_signs_have_a_closed_surface() -> None:
    """Noise has every case of a cube, and faces whose corners alternate."""
    values = np.random.default_rng(0).normal(size=(24, 24, 24))
    values = np.copysign(np.maximum(np.abs(values), 0.05), values)
    border = np.ones_like(values, dtype=bool)
    border[1:-1, 1:-1, 1:-1] = False
    values[border] = 1.0
    vertices, faces = marching_cubes(values)
    component = component_labels(len(vertices), faces)[1][faces[:, 0]]
    assert all(genus(faces[component == part]) is not None for part in np.unique(component))
    assert volume(Mesh(vertices, faces)) > 0.0
