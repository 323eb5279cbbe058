"""Panoramas of known surfaces, against a plain reference, and under reflections of the frame."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from core.descriptors.panorama import (
    ALONG,
    AROUND,
    AZIMUTHS,
    CHANNELS,
    HALF_HEIGHT,
    HEIGHTS,
    kept,
    magnitudes,
    panoramas,
)

RNG = np.random.default_rng(3)
POINTS = RNG.normal(size=(4000, 3)) * [1.0, 0.6, 0.4]
NORMALS = RNG.normal(size=(4000, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)


def plain(points, normals, axes):
    maps = np.zeros((3, CHANNELS, AZIMUTHS, HEIGHTS))
    for a in range(3):
        up, east, north = axes[a], axes[(a + 1) % 3], axes[(a + 2) % 3]
        flat = points - np.outer(points @ up, up)
        radii = np.linalg.norm(flat, axis=1)
        angles = np.arctan2(points @ north, points @ east)
        columns = np.round(angles / (2 * np.pi) * AZIMUTHS).astype(int) % AZIMUTHS
        rows = np.floor((points @ up / HALF_HEIGHT + 1) * HEIGHTS / 2).astype(int).clip(0, HEIGHTS - 1)
        for i, j in {*zip(columns.tolist(), rows.tolist(), strict=True)}:
            here = np.flatnonzero((columns == i) & (rows == j))
            last = here[radii[here].argmax()]
            maps[a, :, i, j] = radii[last], abs(normals[last] @ flat[last]) / radii[last]
    return maps


def axes_of(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def test_panoramas_are_those_of_a_plain_reference():
    axes = axes_of(1)
    assert_allclose(panoramas(POINTS, NORMALS, axes), plain(POINTS, NORMALS, axes), atol=1e-12)


def test_a_cylinder_has_one_radius_and_normals_along_it():
    angles, heights = RNG.uniform(0, 2 * np.pi, 50_000), RNG.uniform(-1, 1, 50_000)
    around = np.stack([np.zeros_like(angles), np.cos(angles), np.sin(angles)], axis=1)
    points = 0.7 * around + heights[:, None] * [1.0, 0.0, 0.0]
    outer, normal = panoramas(points, around, np.eye(3))[0]
    filled = outer > 0.0
    assert_allclose(outer[filled], 0.7)
    assert_allclose(normal[filled], 1.0)
    assert_array_equal(filled.any(axis=0), np.abs(np.linspace(-HALF_HEIGHT, HALF_HEIGHT, HEIGHTS)) < 1.03)


def test_magnitudes_do_not_depend_on_the_signs_of_axes_and_normals():
    axes, flips = axes_of(2), np.where(RNG.random(len(NORMALS)) < 0.5, -1.0, 1.0)[:, None]
    own = panoramas(POINTS, NORMALS, axes)
    assert_array_equal(own, panoramas(POINTS, flips * NORMALS, axes))
    for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1]):
        other = panoramas(POINTS, NORMALS, axes * np.array(signs)[:, None])
        assert_allclose(magnitudes(own), magnitudes(other), atol=1e-9)


def test_magnitudes_are_those_of_the_sum_over_cells():
    map_ = RNG.random((AZIMUTHS, HEIGHTS))
    angles = np.arange(AZIMUTHS) * 2 * np.pi / AZIMUTHS
    heights = (np.arange(HEIGHTS) + 0.5) * np.pi / HEIGHTS
    found = []
    for row in range(2 * AROUND + 1):
        turns = (row + 1) // 2
        wave = np.full(AZIMUTHS, 0.5**0.5) if row == 0 else (np.sin, np.cos)[row % 2](turns * angles)
        for half in range(ALONG + 1):
            if (turns / (AROUND + 0.5)) ** 2 + (half / (ALONG + 0.5)) ** 2 <= 1:
                along = np.cos(half * heights) if half else np.full(HEIGHTS, 0.5**0.5)
                found.append(abs((np.outer(wave, along) * map_).sum()))
    assert len(found) == kept().sum()
    assert_allclose(magnitudes(map_), np.array(found) / sum(found), rtol=1e-9)


def test_a_panorama_that_is_rounding_only_stays_so():
    assert magnitudes(np.full((AZIMUTHS, HEIGHTS), 1e-17)).sum() < 1e-9
