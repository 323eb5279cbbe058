"""Views: what changes them; histograms, signatures and distances against plain references."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from core.descriptors.panorama import ALONG, AROUND
from core.descriptors.view_frames import FRAMES, normalised_surface
from core.descriptors.views import (
    ANGLE_BINS,
    ANGLE_PAIRS,
    DISTANCE_BINS,
    LONGEST,
    MAGNITUDE_SCALE,
    NORMAL_BINS,
    ORIENTED_POINTS,
    PAIR_WEIGHT,
    SHARE_SCALE,
    SIGNATURE_BYTES,
    VIEW_BYTES,
    magnitudes_of,
    pair_histogram,
    shares_of,
    signature_distance,
    to_bytes,
    view_descriptor,
    view_distance,
    view_signature,
)
from core.gallery import CLASSES
from core.mesh.mesh import Mesh
from core.sampling.surface_samples import evenly_spread
from tests.core.shapes import (
    GALLERY,
    MANY_KINDS,
    SAME_SHAPE,
    blob,
    box,
    decimated,
    faces_shuffled,
    icosphere,
    mesh_of,
    rectangle,
    scaled,
    soup,
    star,
    subdivided,
    turned,
)
from tests.gallery import make_shape


def described(mesh):
    return view_descriptor(mesh.vertices, mesh.faces)


@cache
def shapes():
    return {name: mesh_of(make()) for name, make in MANY_KINDS.items()}


@cache
def stored():
    return {name: described(mesh) for name, mesh in shapes().items()}


@cache
def every():
    return np.stack(list(stored().values()))


BETWEEN = 0.6
"""Two different shapes of `MANY_KINDS` are at least so far apart."""


def distance(one, other):
    return float(view_distance(described(one), described(other)[None])[0])


def mirrored(mesh):
    return Mesh(mesh.vertices * [1.0, 1.0, -1.0], mesh.faces)


def turned_over(mesh):
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    return Mesh(mesh.vertices, faces)


def test_different_shapes_are_far_apart():
    distances = np.array([view_distance(one, every()) for one in every()])
    assert distances[~np.eye(len(every()), dtype=bool)].min() > BETWEEN


def test_a_descriptor_is_small_and_the_same_each_time():
    mesh = shapes()["person"]
    assert stored()["person"].dtype == np.uint8
    assert stored()["person"].shape == (VIEW_BYTES,)
    assert VIEW_BYTES <= 4096
    assert_array_equal(stored()["person"], described(Mesh(mesh.vertices.copy(), mesh.faces.copy())))


@pytest.mark.parametrize("name", MANY_KINDS)
def test_order_and_orientation_of_faces_change_nothing(name):
    mesh = shapes()[name]
    assert_array_equal(stored()[name], described(turned_over(mesh)))
    assert_array_equal(stored()[name], described(faces_shuffled(mesh, 1)))


@pytest.mark.parametrize("change", ["turned", "shifted", "scaled", "all of these", "mirrored and turned"])
def test_a_moved_scaled_mirrored_or_reordered_shape_is_the_same(change):
    changes = {**SAME_SHAPE, "mirrored and turned": lambda mesh: turned(mirrored(mesh), 3)}
    # Another order of the vertices moves the sample points.
    limit = 0.2 if change == "all of these" else 0.06
    for name, mesh in shapes().items():
        assert distance(mesh, changes[change](mesh)) < limit, name


@pytest.mark.parametrize("name", [*GALLERY, "loose parts", "blob"])
def test_another_mesh_of_the_surface_is_nearly_the_same(name):
    mesh = shapes()[name]
    assert distance(mesh, soup(mesh)) < 0.2
    assert distance(mesh, subdivided(mesh)) < 0.2
    if len(mesh.faces) > 500:
        assert distance(mesh, decimated(mesh, 0.5)) < 0.3


def test_shapes_of_one_class_are_nearer_than_others():
    queries = np.stack([described(make_shape(label, 1)) for label in GALLERY])
    descriptors = np.stack([stored()[label] for label in GALLERY])
    nearest = np.array([view_distance(query, descriptors).argmin() for query in queries])
    assert (nearest == np.arange(len(GALLERY))).mean() >= 0.9
    signatures = np.stack([view_signature(descriptor) for descriptor in descriptors])
    nearest = np.array([signature_distance(view_signature(one), signatures).argmin() for one in queries])
    assert (nearest == np.arange(len(GALLERY))).mean() >= 0.9


TRIANGLE = Mesh([[0, 0, 0], [1, 0, 0], [0.2, 0.7, 0]], [[0, 1, 2]])
DEGENERATE = {
    "one triangle": TRIANGLE,
    "a sliver": Mesh([[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]], [[0, 1, 2]]),
    "a flat sheet": rectangle(3, 2, 6, 4),
    "a thin bar": box(1.0, 1e-4, 1e-4),
    "a cube": box(1, 1, 1),
    "a square bar": box(3, 1, 1),
    "a plate": box(2, 2, 0.1),
    "a sphere": icosphere(3),
    "a star of three tips": star(3),
    "a star of five tips": star(5),
    "a star of eight tips": star(8),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_flat_thin_and_symmetric_shapes_are_themselves_in_any_pose(name):
    for seed in range(3):
        assert distance(DEGENERATE[name], turned(mirrored(DEGENERATE[name]), seed)) < 0.25
    others = [other for key, other in DEGENERATE.items() if key not in {name, "a sliver", "a thin bar"}]
    assert min(distance(DEGENERATE[name], other) for other in others) > 0.3


def test_extreme_units():
    for factor in (1e-25, 1e25):
        assert_allclose(described(scaled(shapes()["cup"], factor)).astype(int), stored()["cup"], atol=1)


def plain_distance(one, other):
    views = np.abs(magnitudes_of(one) - magnitudes_of(other)).sum(axis=-1).mean(axis=(1, 2)).min()
    return views + PAIR_WEIGHT * np.abs(np.sqrt(shares_of(one)) - np.sqrt(shares_of(other))).sum()


def test_distances_are_those_of_a_plain_reference():
    rng = np.random.default_rng(0)
    many = np.concatenate([every(), rng.integers(0, 256, size=(20, VIEW_BYTES), dtype=np.uint8)])
    for one in many[::5]:
        expected = [plain_distance(one, other) for other in many]
        assert_allclose(view_distance(one, many), expected, rtol=1e-9, atol=1e-12)


def test_bytes_keep_the_features():
    rng = np.random.default_rng(1)
    magnitudes = rng.random(magnitudes_of(every()[0]).shape) / 100
    shares = rng.dirichlet(np.full(shares_of(every()[0]).size, 0.1)).reshape(shares_of(every()[0]).shape)
    kept = to_bytes(magnitudes, shares)
    assert kept.shape == (VIEW_BYTES,)
    assert_allclose(np.sqrt(magnitudes_of(kept)), np.sqrt(magnitudes), atol=0.51 / MAGNITUDE_SCALE)
    assert_allclose(np.sqrt(shares_of(kept)), np.minimum(np.sqrt(shares), 0.5), atol=0.51 / SHARE_SCALE)


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


RNG = np.random.default_rng(0)


def plain_signature(descriptor):
    """The lowest frequencies one by one, and each bin of pairs added to its coarser bin."""
    found, k = [], 0
    magnitudes, shares = magnitudes_of(descriptor), shares_of(descriptor)
    for row in range(2 * AROUND + 1):
        for half in range(ALONG + 1):
            norm = np.hypot((row + 1) // 2 / (AROUND + 0.5), half / (ALONG + 0.5))
            if norm < 0.35:
                found.append(1000.0 * sum(magnitudes[frame, :, :, k] for frame in range(FRAMES)) / FRAMES)
            k += norm <= 1.0
    coarse = np.zeros((4, NORMAL_BINS, 3))
    for i in range(DISTANCE_BINS):
        angles = [(larger, smaller) for larger in range(ANGLE_BINS) for smaller in range(larger + 1)]
        for j, (larger, smaller) in enumerate(angles):
            coarse[i // 3, :, (larger > 2) + (smaller > 2)] += shares[i, :, j]
    values = np.concatenate([np.stack(found, axis=-1).ravel(), 400.0 * np.sqrt(coarse).ravel()])
    return np.minimum(np.rint(values), 255)


def test_a_signature_is_that_of_a_plain_reference():
    made = [make_shape(label, 0) for label in CLASSES[:3]]
    described = [view_descriptor(mesh.vertices, mesh.faces) for mesh in made]
    for descriptor in [*described, RNG.integers(0, 80, VIEW_BYTES, dtype=np.uint8)]:
        signature = view_signature(descriptor)
        assert signature.dtype == np.uint8
        assert signature.shape == (SIGNATURE_BYTES,)
        assert np.abs(signature - plain_signature(descriptor)).max() <= 1
    assert SIGNATURE_BYTES <= 192


def test_distances_are_sums_of_absolute_differences():
    stored = RNG.integers(0, 256, size=(300, SIGNATURE_BYTES), dtype=np.uint8)
    stored[0], stored[1] = 0, 255
    for query in stored[:3]:
        expected = np.abs(stored.astype(int) - query).sum(axis=1)
        assert_array_equal(signature_distance(query, stored), expected)
    assert signature_distance(stored[0], stored[:0]).shape == (0,)
