"""The view descriptor: what changes it, what does not, and its distances against a plain reference."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from core.descriptors.views import (
    MAGNITUDE_SCALE,
    PAIR_WEIGHT,
    SHARE_SCALE,
    VIEW_BYTES,
    magnitudes_of,
    shares_of,
    signature_distance,
    to_bytes,
    view_descriptor,
    view_distance,
    view_signature,
)
from core.errors import DegenerateMeshError
from core.gallery import make_shape
from core.mesh.mesh import Mesh
from tests.core.shapes import (
    GALLERY,
    MANY_KINDS,
    SAME_SHAPE,
    box,
    decimated,
    faces_shuffled,
    icosphere,
    mesh_of,
    rectangle,
    soup,
    star,
    subdivided,
    turned,
)


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


def test_extreme_units_and_a_surface_without_area():
    mesh = shapes()["cup"]
    for factor in (1e-25, 1e25):
        assert_allclose(
            described(Mesh(mesh.vertices * factor, mesh.faces)).astype(int), stored()["cup"], atol=1
        )
    with pytest.raises(DegenerateMeshError):
        view_descriptor(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]))


def plain_distance(one, other):
    views = np.abs(magnitudes_of(one) - magnitudes_of(other)).sum(axis=-1).mean(axis=(1, 2)).min()
    return views + PAIR_WEIGHT * np.abs(np.sqrt(shares_of(one)) - np.sqrt(shares_of(other))).sum()


def test_distances_are_those_of_a_plain_reference():
    rng = np.random.default_rng(0)
    many = np.concatenate([every(), rng.integers(0, 256, size=(20, VIEW_BYTES), dtype=np.uint8)])
    for one in many[::5]:
        expected = [plain_distance(one, other) for other in many]
        assert_allclose(view_distance(one, many), expected, rtol=1e-9, atol=1e-12)


def test_distances_are_symmetric_and_zero_to_themselves():
    distances = np.array([view_distance(one, every()) for one in every()])
    assert_array_equal(distances, distances.T)
    assert_array_equal(np.diag(distances), 0.0)
    assert (distances >= 0.0).all()
    assert view_distance(every()[0], every()[:0]).shape == (0,)


def test_bytes_keep_the_features():
    rng = np.random.default_rng(1)
    magnitudes = rng.random(magnitudes_of(every()[0]).shape) / 100
    shares = rng.dirichlet(np.full(shares_of(every()[0]).size, 0.1)).reshape(shares_of(every()[0]).shape)
    kept = to_bytes(magnitudes, shares)
    assert kept.shape == (VIEW_BYTES,)
    assert_allclose(np.sqrt(magnitudes_of(kept)), np.sqrt(magnitudes), atol=0.51 / MAGNITUDE_SCALE)
    assert_allclose(np.sqrt(shares_of(kept)), np.minimum(np.sqrt(shares), 0.5), atol=0.51 / SHARE_SCALE)
