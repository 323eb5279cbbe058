"""Pair histograms of known surfaces, and against all pairs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from core.descriptors.view_frames import normalised_surface
from core.descriptors.views import (
    ANGLE_BINS,
    ANGLE_PAIRS,
    DISTANCE_BINS,
    LONGEST,
    NORMAL_BINS,
    ORIENTED_POINTS,
    pair_histogram,
)
from core.sampling.surface_samples import evenly_spread
from tests.core.shapes import blob, icosphere, rectangle


def oriented_points(mesh):
    surface = normalised_surface(mesh.vertices, mesh.faces)
    points, faces = evenly_spread(surface.points[mesh.faces], surface.areas, ORIENTED_POINTS)
    return points, surface.normals[faces]


def plain(points, normals):
    """All pairs of every fourth point."""
    points, normals = points[::4], normals[::4]
    first, second = np.triu_indices(len(points), 1)
    steps = points[second] - points[first]
    lengths = np.linalg.norm(steps, axis=1)
    angles = np.abs(np.stack([(normals[k] * steps).sum(axis=1) / lengths for k in (first, second)]))
    low, high = np.minimum((np.sort(angles, axis=0) * ANGLE_BINS).astype(int), ANGLE_BINS - 1)
    between = np.abs((normals[first] * normals[second]).sum(axis=1))
    i = np.minimum((lengths / LONGEST * DISTANCE_BINS).astype(int), DISTANCE_BINS - 1)
    j = np.minimum((between * NORMAL_BINS).astype(int), NORMAL_BINS - 1)
    counts = np.zeros((DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS))
    np.add.at(counts, (i, j, high * (high + 1) // 2 + low), 1.0)
    return counts / counts.sum()


@pytest.mark.parametrize("make", [blob, lambda: blob(4), lambda: rectangle(3, 2, 5, 5)])
def test_a_histogram_is_that_of_all_pairs(make):
    points, normals = oriented_points(make())
    found, all_pairs = pair_histogram(points, normals), plain(points, normals)
    assert found.sum() == pytest.approx(1.0)
    assert np.abs(found - all_pairs).sum() < 0.1
    assert np.abs(found - plain(*oriented_points(icosphere()))).sum() > 0.5


def test_each_point_has_as_many_partners_as_every_other():
    # Points on a line, one of them far away: it is in 16 pairs as the first and in 16 as the second.
    points = np.zeros((ORIENTED_POINTS, 3))
    points[:, 0] = 0.001 * np.arange(ORIENTED_POINTS) / ORIENTED_POINTS
    points[1000] = [0.0, 100.0, 0.0]
    normals = np.tile([0.0, 0.0, 1.0], (ORIENTED_POINTS, 1))
    share = pair_histogram(points, normals)[-1].sum()
    assert share == pytest.approx(32 / (16 * ORIENTED_POINTS))


def test_neither_signs_of_normals_nor_motion_matter():
    points, normals = oriented_points(blob(2))
    flips = np.where(np.arange(len(points)) % 3 == 0, -1.0, 1.0)[:, None]
    own = pair_histogram(points, normals)
    assert_array_equal(own, pair_histogram(points, flips * normals))
    axes = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert_allclose(own, pair_histogram(points @ axes.T + 2.0, normals @ axes.T), atol=1e-3)


def test_on_a_flat_sheet_all_normals_agree():
    counts = pair_histogram(*oriented_points(rectangle(3, 2, 5, 5)))
    assert counts[:, NORMAL_BINS - 1, 0].sum() == pytest.approx(1.0)
