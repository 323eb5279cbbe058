"""Each baseline against motions, distances and spectra that are known, and what does not change a shape."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from trimesh.creation import icosphere

from core.errors import DegenerateMeshError
from core.gallery import make_shape
from core.mesh.mesh import Mesh
from service.evaluation.baselines import (
    BASELINES,
    BINS,
    EIGENVALUES,
    ICP_POINTS,
    MDS_POINTS,
    RANGE,
    bent_form,
    canonical_form,
    closest_motion,
    distance_distribution,
    histogram_distances,
    random_points,
    spectral_distances,
    spectrum,
)

# All of them


@pytest.mark.parametrize("name", ["icp", "shapedna", "d2"])
def test_place_and_size_do_not_matter_and_classes_are_told_apart(name: str) -> None:
    cup, another, pliers = (make_shape(*which) for which in (("cup", 0), ("cup", 1), ("pliers", 0)))
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned = Mesh(7.0 * cup.vertices @ (np.linalg.det(turn) * turn).T + np.array([5.0, -3.0, 1.0]), cup.faces)
    first, *others = map(BASELINES[name].describe, (cup, turned, another, pliers))
    same, of_class, other = BASELINES[name].compare(first, others)
    assert same < 1e-6 < of_class < other


@pytest.mark.parametrize(("compare", "order"), [(spectral_distances, 2), (histogram_distances, 1)])
def test_distances_are_those_of_vectors(compare: Callable[..., np.ndarray], order: int) -> None:
    first, second = np.random.default_rng(0).random((2, 20))
    assert compare(first, [first, second]) == pytest.approx([0.0, np.linalg.norm(first - second, order)])


# ICP


@pytest.fixture(scope="module")
def cloud() -> np.ndarray:
    """A cloud without symmetry, centred, along its principal axes."""
    random = np.random.default_rng(1)
    points = random.normal(size=(300, 3)) * [3.0, 2.0, 1.0] + random.exponential(size=(300, 3))
    points -= points.mean(axis=0)
    return points @ np.linalg.svd(points, full_matrices=False)[2].T


@pytest.mark.parametrize("half_turn", ["x", "y", "z"])
def test_a_turned_copy_is_found_from_any_start(cloud: np.ndarray, half_turn: str) -> None:
    turn = Rotation.from_euler(half_turn, np.pi) * Rotation.from_euler("xyz", [0.1, -0.1, 0.05])
    assert closest_motion(turn.apply(cloud) + np.array([0.1, 0.0, -0.1]), cloud) < 1e-6


def test_a_mirrored_copy_is_found_only_where_mirrors_count(cloud: np.ndarray) -> None:
    mirrored = cloud * [1.0, 1.0, -1.0]
    assert closest_motion(mirrored, cloud, mirrored=True) < 1e-6
    assert closest_motion(mirrored, cloud) > 0.1


def test_the_distance_counts_both_ways() -> None:
    # Each point of the first lies on one of the second; of the second, one in five lies 1 from the first.
    first = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    second = np.vstack([first, [[0.0, 0, 1]], [[0, 0, -1]]])
    away = np.sqrt(2.0)
    expected = np.sqrt(0.5 * (0.0 + 2.0 * away**2 / 6.0))
    assert closest_motion(first, second) == pytest.approx(expected)


def test_points_lie_on_the_surface_evenly_by_area() -> None:
    # A box of 4 x 2 x 1: its faces have 8, 8, 4, 4, 2, 2 of 28 parts of the area.
    corners = np.array([[x, y, z] for x in (0, 4) for y in (0, 2) for z in (0, 1)], dtype=float)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    points = random_points(Mesh(corners, faces))
    assert points.shape == (ICP_POINTS, 3)
    scale = np.abs(points).max(axis=0) / [2.0, 1.0, 0.5]
    assert scale == pytest.approx(np.full(3, scale[0]), rel=1e-9)
    on = np.isclose(np.abs(points) / scale, [2.0, 1.0, 0.5])
    assert on.any(axis=1).all()
    assert on.mean(axis=0) == pytest.approx([4 / 28, 8 / 28, 16 / 28], abs=0.06)


# MDS


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
    flat, bent, cup = (bent_form(mesh) for mesh in (sheet(False), sheet(True), make_shape("cup", 0)))
    assert flat.shape == (MDS_POINTS, 3)
    same, other = BASELINES["mds"].compare(flat, [bent, cup])
    assert same < 0.12
    assert other > 3.0 * same


def test_a_form_is_its_own_mirror_image() -> None:
    form = bent_form(make_shape("pliers", 0))
    assert BASELINES["mds"].compare(form, [form, form * [1.0, -1.0, 1.0]]) == pytest.approx(
        [0.0, 0.0], abs=1e-6
    )


# ShapeDNA


def sphere(radius: float) -> Mesh:
    made = icosphere(subdivisions=4)
    return Mesh(radius * made.vertices, made.faces)


def test_a_sphere_has_its_known_spectrum() -> None:
    # On the unit sphere the eigenvalue l (l + 1) comes 2 l + 1 times; the area is 4 pi.
    known = np.repeat([2.0, 6.0, 12.0], [3, 5, 7]) * 4.0 * np.pi / np.arange(1, EIGENVALUES + 1)
    assert spectrum(sphere(1.0)) == pytest.approx(known, rel=0.01)


def test_size_does_not_matter_to_a_spectrum() -> None:
    assert spectrum(sphere(1000.0)) == pytest.approx(spectrum(sphere(0.001)), rel=1e-9)


def test_loose_and_broken_parts_have_a_spectrum() -> None:
    cup = make_shape("cup", 0)
    broken = Mesh(
        np.vstack([cup.vertices, cup.vertices + np.array([9.0, 0.0, 0.0])]),
        np.vstack([cup.faces[::2], cup.faces + len(cup.vertices)]),
    )
    assert np.isfinite(spectrum(broken)).all()


# D2


def test_a_sphere_has_its_known_distribution() -> None:
    # On the unit sphere the density of the distance d is d / 2 up to 2, and its mean is 4 / 3.
    ball = icosphere(subdivisions=4)
    edges = np.minimum(np.linspace(0.0, RANGE, BINS + 1) * 4.0 / 3.0, 2.0)
    assert distance_distribution(Mesh(ball.vertices, ball.faces)) == pytest.approx(
        np.diff(edges**2 / 4.0), abs=0.002
    )


def test_a_soup_is_described_as_its_surface() -> None:
    cup = make_shape("cup", 0)
    soup = Mesh(cup.vertices[cup.faces].reshape(-1, 3), np.arange(3 * len(cup.faces)).reshape(-1, 3))
    assert distance_distribution(soup) == pytest.approx(distance_distribution(cup), abs=1e-3)


def test_no_area_is_an_error() -> None:
    with pytest.raises(DegenerateMeshError):
        distance_distribution(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))
