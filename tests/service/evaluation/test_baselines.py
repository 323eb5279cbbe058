"""Each baseline against motions, distances and spectra that are known, and what does not change a shape."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from core.errors import DegenerateMeshError
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
    random_points,
    spectrum,
)
from tests.core.shapes import box, icosphere, joined, rectangle, scaled, shifted, soup, turned
from tests.gallery import make_shape

# All of them


@pytest.mark.parametrize("name", ["icp", "shapedna", "d2"])
def test_place_and_size_do_not_matter_and_classes_are_told_apart(name: str) -> None:
    cup, another, pliers = (make_shape(*which) for which in (("cup", 0), ("cup", 1), ("pliers", 0)))
    moved = shifted(scaled(turned(cup, 0), 7.0), (5.0, -3.0, 1.0))
    first, *others = map(BASELINES[name].describe, (cup, moved, another, pliers))
    same, of_class, other = BASELINES[name].compare(first, others)
    assert same < 1e-6 < of_class < other


@pytest.mark.parametrize(("name", "order"), [("shapedna", 2), ("d2", 1)])
def test_distances_are_those_of_vectors(name: str, order: int) -> None:
    first, second = np.random.default_rng(0).random((2, 20))
    assert BASELINES[name].compare(first, [first, second]) == pytest.approx(
        [0.0, np.linalg.norm(first - second, order)]
    )


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
    # The faces of the box have 8, 8, 4, 4, 2, 2 of 28 parts of the area.
    points = random_points(box(4, 2, 1))
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
    flat = rectangle(3, 1, 60, 20)
    along, across, z = flat.vertices.T
    radius = 0.6
    x = along
    if bent:
        x, z = radius * np.sin(along / radius), radius * (1.0 - np.cos(along / radius))
    kept = (along + 2.0 * across)[flat.faces].max(axis=1) < 4.0
    return Mesh(np.column_stack([x, across, z]), flat.faces[kept])


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


def test_a_sphere_has_its_known_spectrum() -> None:
    # On the unit sphere the eigenvalue l (l + 1) comes 2 l + 1 times; the area is 4 pi.
    known = np.repeat([2.0, 6.0, 12.0], [3, 5, 7]) * 4.0 * np.pi / np.arange(1, EIGENVALUES + 1)
    assert spectrum(icosphere(4)) == pytest.approx(known, rel=0.01)


def test_size_does_not_matter_to_a_spectrum() -> None:
    assert spectrum(icosphere(4, 1000.0)) == pytest.approx(spectrum(icosphere(4, 0.001)), rel=1e-9)


def test_loose_and_broken_parts_have_a_spectrum() -> None:
    cup = make_shape("cup", 0)
    broken = joined(Mesh(cup.vertices, cup.faces[::2]), shifted(cup, (9.0, 0.0, 0.0)))
    assert np.isfinite(spectrum(broken)).all()


# D2


def test_a_sphere_has_its_known_distribution() -> None:
    # On the unit sphere the density of the distance d is d / 2 up to 2, and its mean is 4 / 3.
    edges = np.minimum(np.linspace(0.0, RANGE, BINS + 1) * 4.0 / 3.0, 2.0)
    assert distance_distribution(icosphere(4)) == pytest.approx(np.diff(edges**2 / 4.0), abs=0.002)


def test_a_soup_is_described_as_its_surface() -> None:
    cup = make_shape("cup", 0)
    assert distance_distribution(soup(cup, 1.0)) == pytest.approx(distance_distribution(cup), abs=1e-3)


def test_no_area_is_an_error() -> None:
    with pytest.raises(DegenerateMeshError):
        distance_distribution(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))
