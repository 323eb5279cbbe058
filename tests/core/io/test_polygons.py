"""Triangles of polygons: convex, concave, with holes, in any plane and any format that has polygons."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from core.io import read_mesh
from tests.core.io.files import binary_ply, obj, off, ply, stl
from tests.core.shapes import area, volume

PROFILES = {
    "channel": [(0, 0), (40, 0), (40, 30), (35, 30), (35, 5), (5, 5), (5, 30), (0, 30)],
    "angle": [(0, 0), (50, 0), (50, 6), (6, 6), (6, 40), (0, 40)],
    "points along its sides": [(0, 0), (1, 0), (2, 0), (2, 1), (1.5, 1), (1, 1), (1, 2), (0, 2), (0, 1)],
    "arrow": [(0, 0), (4, -2), (1, 0), (4, 2)],
    "hole": [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)],
    "cut": [(0, 0), (4, -1), (8, 0), (8, 3), (4, 3), (4, 1), (4, 2), (0, 2)],
    "cut aslant": [(0, 0), (6, 0), (6, 2), (3, 2), (1, 1), (2, 1.5), (0, 3)],
    "star": [
        (r * np.cos(k), r * np.sin(k))
        for k, r in zip(np.arange(48) * np.pi / 24, [25, 25, 9] * 16, strict=True)
    ],
}


def shoelace(profile):
    """Area of a polygon in the plane."""
    x, y = np.transpose(profile)
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


def prism(profile, height=12.0):
    """The vertices and polygons of a body with a polygon as its floor and its ceiling."""
    n = len(profile)
    vertices = [(x, y, z) for z in (0.0, height) for x, y in profile]
    walls = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    return np.array(vertices), [list(range(n))[::-1], list(range(n, 2 * n)), *walls]


def rim(profile):
    return float(np.linalg.norm(np.roll(profile, -1, axis=0) - np.array(profile), axis=1).sum())


@pytest.mark.parametrize("turn", range(3))
@pytest.mark.parametrize("write", [obj, off, ply, binary_ply])
@pytest.mark.parametrize("name", PROFILES)
def test_a_prism_has_the_area_and_the_volume_of_its_profile(name, write, turn):
    profile = PROFILES[name]
    vertices, polygons = prism(profile)
    turned = Rotation.from_euler("xyz", [turn, 2 * turn, 0.3 * turn]).apply(vertices) + 5.0 * turn
    format = "ply" if write is binary_ply else write.__name__
    mesh = read_mesh(write(turned, polygons), format)
    assert len(mesh.faces) == sum(len(polygon) - 2 for polygon in polygons)
    assert area(mesh) == pytest.approx(2 * shoelace(profile) + 12 * rim(profile), rel=1e-6)
    assert volume(mesh) == pytest.approx(12 * shoelace(profile), rel=1e-6)


def test_the_facets_of_an_stl_may_be_concave():
    profile = [(x, y, 0.0) for x, y in PROFILES["channel"]]
    assert area(read_mesh(stl([profile]), "stl")) == pytest.approx(shoelace(PROFILES["channel"]))


@given(
    radii=st.lists(st.floats(0.05, 1.0), min_size=4, max_size=60),
    axis=st.tuples(*[st.floats(-1, 1)] * 3),
    start=st.integers(0, 59),
)
def test_a_polygon_around_a_point_is_covered_once(radii, axis, start):
    """Its area is that of the sectors, wherever it begins and however it lies."""
    angles = np.arange(len(radii)) * 2 * np.pi / len(radii)
    profile = np.roll(np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1), start, axis=0)
    points = Rotation.from_rotvec(axis).apply(np.c_[profile, np.zeros(len(profile))])
    mesh = read_mesh(off(points, [list(range(len(points)))]), "off")
    assert area(mesh) == pytest.approx(shoelace(profile), rel=1e-5)


def test_a_quadrilateral_that_is_not_flat_and_one_that_is_crossed_are_read():
    saddle = np.array([(0, 0, 0), (1, 0, 1), (1, 1, 0), (0, 1, 1)], dtype=float)
    assert len(read_mesh(off(saddle, [[0, 1, 2, 3]]), "off").faces) == 2
    crossed = np.array([(0, 0, 0), (3, 1, 0), (3, 0, 0), (0, 2, 0)], dtype=float)
    assert len(read_mesh(off(crossed, [[0, 1, 2, 3]]), "off").faces) == 2
