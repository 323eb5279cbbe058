"""The gallery: sound surfaces of the right kind, drawn from a seed, and the fields they come from."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from core.errors import MeshError, ParameterError
from core.gallery import CLASSES, bodies, collection, make_shape
from core.gallery.solids import (
    Frame,
    box,
    capsule,
    chain,
    ellipsoid,
    plate,
    polygon_distance,
    revolved,
    rotation,
    tube,
)
from core.gallery.surface import genus, smooth_minimum, surface
from tests.core.shapes import as_trimesh
from tests.gallery import make_shape as made_once

POSES = 5
# Handles by what the things are: a cup has one, an empty pair of spectacles a loop for each eye.
GENUS = dict.fromkeys(CLASSES, 0) | {"cup": 1, "glasses": 2}


@pytest.fixture(scope="module")
def gallery():
    return {label: [made_once(label, pose) for pose in range(POSES)] for label in CLASSES}


@pytest.mark.parametrize("label", CLASSES)
def test_every_shape_is_a_closed_surface_of_its_kind(gallery, label):
    for shape in [*gallery[label], make_shape(label, 1_000_003)]:
        mesh = as_trimesh(shape)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume > 0
        assert len(mesh.split(only_watertight=False)) == 1
        assert mesh.euler_number == 2 - 2 * GENUS[label]
        assert len(np.unique(shape.faces)) == len(shape.vertices)
        assert 800 <= len(shape.vertices) <= 4000


def test_no_face_is_degenerate_and_few_are_slivers(gallery):
    smallest = []
    for shape in itertools.chain.from_iterable(gallery.values()):
        a, b, c = shape.vertices[shape.faces.T]
        sides = np.sort([np.linalg.norm(u - v, axis=1) for u, v in ((a, b), (b, c), (c, a))], axis=0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        assert area.min() > 1e-5 * area.mean()
        smallest.append(np.degrees(np.arcsin(np.clip(2 * area / (sides[1] * sides[2]), 0, 1))))
        assert np.median(smallest[-1]) > 20
    assert np.percentile(np.concatenate(smallest), 1) > 8


@pytest.mark.parametrize("label", CLASSES)
def test_poses_and_proportions_vary(gallery, label):
    meshes = [as_trimesh(shape) for shape in gallery[label]]
    # Without size: area^1.5 / volume, the hull's volume to the solid's, and the ratios of the principal axes.
    compactness = np.log([mesh.area**1.5 / mesh.volume for mesh in meshes])
    fill = np.log([ConvexHull(mesh.vertices).volume / mesh.volume for mesh in meshes])
    spread = np.array([np.linalg.svd(m.vertices - m.vertices.mean(axis=0), compute_uv=False) for m in meshes])
    ratios = np.log(spread[:, :2] / spread[:, 2:])
    forms = np.column_stack([compactness, fill, ratios])
    gaps = np.linalg.norm(forms[:, None] - forms[None], axis=2)[np.triu_indices(POSES, 1)]
    assert gaps.min() > 0.01
    assert gaps.max() > 0.2
    assert len({len(mesh.vertices) for mesh in meshes}) > POSES // 2
    assert np.ptp(np.log([mesh.area for mesh in meshes])) > 1
    assert np.linalg.norm(np.ptp([mesh.centroid for mesh in meshes], axis=0)) > 1


def test_another_seed_and_another_pose_give_another_shape(gallery):
    stored = gallery["octopus"][2]
    assert np.array_equal(make_shape("octopus", 2).vertices, stored.vertices)
    for other in (make_shape("octopus", 2, seed=1), make_shape("octopus", 3)):
        assert other.vertices.shape != stored.vertices.shape or not np.allclose(
            other.vertices, stored.vertices
        )


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: make_shape("unicorn", 0),
        lambda: make_shape("person", -1),
        lambda: make_shape("person", 0, seed=-1),
        lambda: bodies.make_body("unicorn"),
        lambda: bodies.make_body("cup", -1),
        lambda: bodies.make_body("cup").posed(-1),
    ],
)
def test_unknown_classes_and_negative_numbers_are_refused(wrong):
    with pytest.raises(ParameterError):
        wrong()


def test_a_class_that_never_comes_out_sound_is_an_error(monkeypatch):
    monkeypatch.setitem(collection.KINDS, "pliers", replace(collection.KINDS["pliers"], handles=3))
    with pytest.raises(MeshError, match="pliers"):
        make_shape("pliers", 0)


def test_a_ball_has_the_area_and_volume_of_a_ball():
    vertices, faces = surface([ellipsoid(Frame(), (1.0, 1.0, 1.0), blend=0.0)], 3000)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.01)
    assert mesh.area == pytest.approx(4 * np.pi, rel=0.01)
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.01


def test_touching_limbs_show_as_a_handle():
    angles = np.linspace(0, 2 * np.pi, 25)
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    closed = surface([tube(ring, np.full(25, 0.2), blend=0.0)], 1000)[1]
    cut = surface([tube(ring[:-4], np.full(21, 0.2), blend=0.0)], 1000)[1]
    assert (genus(closed), genus(cut)) == (1, 0)


def test_open_pinched_and_parted_surfaces_are_told():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    assert genus(tetrahedron) == genus(2 * tetrahedron) == 0
    assert genus(tetrahedron[:3]) is None
    assert genus(np.vstack([tetrahedron[:3], tetrahedron[3:, ::-1]])) is None
    pinched = np.vstack([tetrahedron, np.where(tetrahedron == 0, 0, tetrahedron + 3)])
    assert genus(pinched) is None
    assert genus(np.vstack([tetrahedron, tetrahedron + 4])) is None


def test_fields_are_distances():
    rng = np.random.default_rng(5)
    points = rng.uniform(-2, 2, size=(3000, 3))
    frame = Frame(np.array([0.2, -0.1, 0.3]), rotation("z", 40) @ rotation("x", 25))
    square = [(-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4)]
    across = np.array([0.0, 0.0, 1.0])
    solids = {
        "ball": (ellipsoid(frame, (0.5,) * 3, blend=0), lambda p: np.linalg.norm(p, axis=1) - 0.5),
        "box": (box(frame, (1, 0.8, 0.6), rounding=0.1, blend=0), lambda p: _box(p, [0.4, 0.3, 0.2]) - 0.1),
        "plate": (plate(frame, square, 0.2, blend=0), lambda p: np.maximum(_box(p, [0.5, 0.4, 0]), 0) - 0.1),
        "turned": (
            revolved(frame, [(0.0, -0.3), (0.6, -0.3), (0.6, 0.3), (0.0, 0.3)], 0.1, blend=0),
            lambda p: _box(np.column_stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]]), [0.6, 0.3]) - 0.1,
        ),
        "capsule": (
            tube(np.array([frame.at(-1), frame.at(1)]), (0.3, 0.3), blend=0, across=across),
            lambda p: np.linalg.norm(p - np.clip(p, [-1, 0, 0], [1, 0, 0]), axis=1) - 0.3,
        ),
    }
    for name, (part, truth) in solids.items():
        (field,) = part.fields
        expected = truth(frame.local(points))
        outside = expected > 0
        np.testing.assert_allclose(
            field.distance(points)[outside], expected[outside], atol=1e-9, err_msg=name
        )
        assert (np.sign(field.distance(points)) == np.sign(expected)).all(), name
        inside = points[~outside]
        assert len(inside) > 5, name
        assert (inside >= field.low).all(), name
        assert (inside <= field.high).all(), name


def _box(points, half):
    beyond = np.abs(points) - np.array(half)
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def test_a_squashed_capsule_is_thinner_across():
    field = capsule(np.zeros(3), np.array([1.0, 0, 0]), (0.4, 0.4), np.array([0.0, 0, 1]), 2.0)
    on_surface = np.array([[0.5, 0.4, 0], [0.5, 0, 0.2], [-0.4, 0, 0], [1.4, 0, 0]])
    np.testing.assert_allclose(field.distance(on_surface), 0, atol=1e-12)
    np.testing.assert_allclose(field.distance(np.array([[0.5, 0, 0.21]])), 0.01, atol=1e-12)


def test_a_polygon_that_is_not_convex_has_its_inside():
    corner = np.array([[0.0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    points = np.array([[0.5, 0.5], [1.5, 1.5], [0.5, 1.9], [3.0, 0.5], [1.5, 0.75]])
    expected = [-0.5, 0.5, -0.1, 1.0, -0.25]
    np.testing.assert_allclose(polygon_distance(points, corner), expected, atol=1e-12)


def test_the_smooth_minimum_is_the_minimum_where_they_differ_and_below_it_where_they_meet():
    first, second = np.array([0.0, 1.0, 0.3]), np.array([1.0, 0.2, 0.3])
    np.testing.assert_allclose(smooth_minimum(first, second, 0.4), [0.0, 0.2, 0.2])
    np.testing.assert_allclose(smooth_minimum(first, second, 0.0), [0.0, 0.2, 0.3])


def test_a_chain_bends_at_its_joints():
    joints, end = chain(Frame(), [1.0, 2.0, 1.0], [(0, 0), (0, 90), (90, 0)])
    np.testing.assert_allclose(joints, [[0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, -1]], atol=1e-12)
    np.testing.assert_allclose(end.axes[:, 0], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(end.axes.T @ end.axes, np.eye(3), atol=1e-12)
