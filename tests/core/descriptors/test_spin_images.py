"""Patches against a plain reference, and what leaves them as they are."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from core.arrays import Bytes
from core.descriptors.spin_images import (
    BATCH,
    BYTE_SCALE,
    HEIGHT_BINS,
    KEYPOINTS,
    POINTS,
    RADIAL_BINS,
    RADII,
    SPIN_IMAGE_LENGTH,
    spin_image_distances,
    spin_images,
)
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.sampling.surface_samples import evenly_spread
from tests.core.shapes import scaled, shifted, turned
from tests.gallery import make_shape


@cache
def person():
    return clean(make_shape("person", 0)).mesh


@cache
def others():
    labels = ("cup", "octopus", "plane", "bird")
    return [spin_images(clean(make_shape(label, 0)).mesh).bytes for label in labels]


def plain(surface: Mesh, missing: float, key: int) -> list[float]:
    """The bytes of one patch, before they are rounded, point by point."""
    areas = face_areas(surface.vertices, surface.faces)
    corners = surface.vertices[surface.faces]
    unit = np.sqrt(areas.sum() / (1.0 - missing))
    points, faces = evenly_spread(
        (corners - corners.mean(axis=(0, 1))) / unit, areas, round(POINTS * (1.0 - missing))
    )
    place = round(key / (round(KEYPOINTS * (1.0 - missing)) - 1) * (len(points) - 1) - 0.5 + 1e-9)
    a, b, c = corners[faces[place]]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    steps = points - points[place]
    distances = np.linalg.norm(steps, axis=1)
    if (steps[distances < max(RADII)] @ normal).sum() > 0.0:
        normal = -normal
    counts = []
    for radius in RADII:
        near = steps[distances < radius]
        heights = near @ normal
        across = np.sqrt(np.maximum((near**2).sum(axis=1) - heights**2, 0.0))
        edges = np.linspace(0.0, radius, RADIAL_BINS + 1), np.linspace(-radius, radius, HEIGHT_BINS + 1)
        table = np.histogram2d(across, heights, bins=edges)[0].T
        counts += (BYTE_SCALE * np.sqrt(table / (POINTS * radius**2))).ravel().tolist()
    return counts


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_patches_are_histograms_of_the_points_nearby(missing: float) -> None:
    found = spin_images(person(), missing)
    assert found.bytes.shape == (round(KEYPOINTS * (1.0 - missing)), SPIN_IMAGE_LENGTH)
    for key in (0, 17, 60, len(found.bytes) - 1):
        # A point at the edge of two bins may lie in either.
        wrong = np.abs(found.bytes[key] - np.array(plain(person(), missing, key))) > 0.5001
        assert wrong.sum() <= 2


def slow(first: Bytes, second: Bytes) -> float:
    rows = [((second.astype(float) - row.astype(float)) ** 2).sum(axis=1).min() for row in first]
    return float(np.mean(rows)) / BYTE_SCALE**2


def test_distances_are_those_of_a_search_over_all_pairs() -> None:
    own = spin_images(person()).bytes
    found = spin_image_distances(own, others())
    for row, other in zip(found, others(), strict=True):
        assert row == pytest.approx([slow(own, other), slow(other, own)], rel=1e-12)
    assert_array_equal(spin_image_distances(own, [own]), [[0.0, 0.0]])


def test_a_distance_hangs_on_no_other_and_on_no_order() -> None:
    own = spin_images(person()).bytes
    many = [others()[i % 4] for i in range(2 * BATCH + 3)]
    found = spin_image_distances(own, many)
    for row, other in zip(found, many, strict=True):
        assert_array_equal(row, spin_image_distances(own, [other])[0])
        assert_array_equal(row[::-1], spin_image_distances(other, [own])[0])


def test_motion_unit_and_the_side_that_faces_turn_to_change_next_to_nothing() -> None:
    own = spin_images(person()).bytes
    flipped = person().faces.copy()
    flipped[::3] = flipped[::3, ::-1]
    moved = shifted(scaled(turned(person(), 1), 250.0), [1.0, -2.0, 3.0])
    assert spin_image_distances(own, [spin_images(moved).bytes]).max() < 0.01
    # Points lie elsewhere on faces whose corners come in another order.
    assert spin_image_distances(own, [spin_images(Mesh(person().vertices, flipped)).bytes]).max() < 0.2
    assert spin_image_distances(own, others()).min() > 0.5
