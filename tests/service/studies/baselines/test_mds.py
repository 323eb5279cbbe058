"""Canonical forms, against distances that are known and a surface that is bent without stretching."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from core.gallery import make_shape
from core.mesh.mesh import Mesh
from service.studies.baselines.mds import POINTS, canonical_form, compare, describe


def test_distances_of_space_are_kept_exactly() -> None:
    points = np.random.default_rng(2).normal(size=(60, 3)) * [3.0, 2.0, 1.0]
    distances = cdist(points, points)
    form = canonical_form(distances)
    radius = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert cdist(form, form) == pytest.approx(distances / radius, abs=1e-4)
    assert form.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    assert (form**2).sum(axis=1).mean() == pytest.approx(1.0)
    moments = form.T @ form
    assert moments == pytest.approx(np.diag(np.diag(moments)), abs=1e-6 * moments[0, 0])
    assert moments[0, 0] > moments[1, 1] > moments[2, 2]


def sheet(bent: bool) -> Mesh:
    """A strip of 3 by 1 with one corner cut off, flat or rolled into most of a ring."""
    rows, columns = 61, 21
    along, across = np.meshgrid(np.linspace(0, 3, rows), np.linspace(0, 1, columns), indexing="ij")
    radius = 0.6
    if bent:
        x, z = radius * np.sin(along / radius), radius * (1.0 - np.cos(along / radius))
    else:
        x, z = along, np.zeros_like(along)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.vstack(
        [
            np.column_stack([corner, corner + columns, corner + columns + 1]),
            np.column_stack([corner, corner + columns + 1, corner + 1]),
        ]
    )
    kept = (along + 2.0 * across).ravel()[faces].max(axis=1) < 4.0
    return Mesh(np.column_stack([x.ravel(), across.ravel(), z.ravel()]), faces[kept])


def test_bending_leaves_the_canonical_form() -> None:
    flat, bent, cup = (describe(mesh) for mesh in (sheet(False), sheet(True), make_shape("cup", 0)))
    assert flat.shape == (POINTS, 3)
    same, other = compare(flat, [bent, cup])
    assert same < 0.12
    assert other > 3.0 * same


def test_a_form_is_its_own_mirror_image() -> None:
    form = describe(make_shape("pliers", 0))
    assert compare(form, [form, form * [1.0, -1.0, 1.0]]) == pytest.approx([0.0, 0.0], abs=1e-6)
