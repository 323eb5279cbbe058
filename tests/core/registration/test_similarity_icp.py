"""The alignment of surfaces against motions, scales, meshings and mirrorings that are known."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from core.gallery import make_shape
from core.gallery.poses_of_one_person import make_person
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.mesh.simplification import simplify
from core.registration.similarity_icp import RESIDUAL, Alignment, align, best_similarity
from core.sampling.closest_on_triangles import closest_on_triangles
from core.sampling.surface_samples import closest_points, surface_samples
from core.studies.perturbation import subdivide

PERSON = make_person(0, 0)


def orthogonal(seed: int, sign: int) -> np.ndarray:
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn[0] *= sign * np.sign(np.linalg.det(turn))
    return turn


def moved(mesh: Mesh, *, scale: float = 1.0, sign: int = 1, seed: int = 0) -> Mesh:
    faces = mesh.faces if sign > 0 else mesh.faces[:, ::-1]
    return Mesh(scale * mesh.vertices @ orthogonal(seed, sign).T + [3.0, -1.0, 2.0], faces)


def simplified(mesh: Mesh) -> Mesh:
    frame = normal_frame(mesh)
    made = simplify(Mesh(frame.apply(mesh.vertices), mesh.faces), len(mesh.vertices) // 2)
    return Mesh(frame.invert(made.vertices), made.faces)


def between(first: Mesh, second: Mesh) -> Alignment:
    return align(surface_samples(first), surface_samples(second))


@pytest.mark.parametrize("sign", [1, -1])
def test_the_similarity_of_paired_points_is_the_one_they_were_moved_by(sign: int) -> None:
    points = np.random.default_rng(1).normal(size=(20, 3))
    turn = orthogonal(2, sign)
    target = 1.7 * points @ turn.T + [1.0, 2.0, 3.0]
    found = best_similarity(points, target, sign=sign, scaled=True)
    assert found.scale == pytest.approx(1.7)
    assert_allclose(found.rotation, turn, atol=1e-12)
    assert_allclose(found.apply(points), target, atol=1e-12)
    assert_allclose(found.invert(target), points, atol=1e-12)


def test_the_determinant_is_the_one_asked_for_and_no_rotation_nearby_is_better() -> None:
    draws = np.random.default_rng(3)
    points, target = draws.normal(size=(2, 15, 3))
    for sign in (1, -1):
        found = best_similarity(points, target, sign=sign, scaled=False)
        assert np.linalg.det(found.rotation) == pytest.approx(sign)
        assert found.scale == 1.0
        least = ((found.apply(points) - target) ** 2).sum()
        for _ in range(50):
            axis = 0.1 * draws.normal(size=3)
            skew = np.cross(np.eye(3), axis)
            turn = np.linalg.solve(np.eye(3) + skew, np.eye(3) - skew) @ found.rotation
            other = points @ turn.T + target.mean(axis=0) - turn @ points.mean(axis=0)
            assert ((other - target) ** 2).sum() > least


def test_the_closest_point_of_a_triangle_is_that_of_a_search_over_its_inside() -> None:
    draws = np.random.default_rng(4)
    for corners, point in zip(draws.normal(size=(40, 3, 3)), draws.normal(size=(40, 3)), strict=True):
        (found,) = closest_on_triangles(corners[None], np.zeros((1, 1), dtype=np.int64), point[None])
        searched = minimize(
            lambda shares, corners=corners, point=point: float(((shares @ corners - point) ** 2).sum()),
            np.full(3, 1.0 / 3.0),
            bounds=[(0.0, 1.0)] * 3,
            constraints={"type": "eq", "fun": lambda shares: shares.sum() - 1.0},
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert_allclose(found, searched.x @ corners, atol=1e-4)


def test_points_are_spread_by_area_on_a_surface_of_unit_area() -> None:
    made = surface_samples(make_shape("cup", 0))
    areas = 0.5 * np.linalg.norm(
        np.cross(made.corners[:, 1] - made.corners[:, 0], made.corners[:, 2] - made.corners[:, 0]), axis=1
    )
    assert areas.sum() == pytest.approx(1.0)
    counts = np.bincount(made.faces, minlength=len(areas))
    assert (np.abs(counts - len(made.points) * areas) <= 1.0 + 1e-6).all()
    assert_allclose(closest_points(made, made.points), made.points, atol=1e-9)


def test_a_turned_copy_is_the_same() -> None:
    found = between(PERSON, moved(PERSON))
    assert found.residual < 1e-6
    assert found.kinship() == "same"


@pytest.mark.parametrize("scale", [0.5, 1.1])
def test_a_copy_in_another_size_is_scaled_by_that_factor(scale: float) -> None:
    found = between(PERSON, moved(PERSON, scale=scale))
    assert found.scale == pytest.approx(scale, rel=1e-3)
    assert found.kinship() == "scaled"


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_mirror_image_is_told_by_the_determinant(scale: float) -> None:
    found = between(PERSON, moved(PERSON, scale=scale, sign=-1))
    assert found.kinship() == "mirrored"
    assert found.scale == pytest.approx(scale, rel=1e-2)


def test_the_mirror_image_of_a_symmetric_surface_is_the_same() -> None:
    cup = make_shape("cup", 0)
    assert between(cup, moved(cup, sign=-1)).kinship() == "same"


@pytest.mark.parametrize("remeshed", [lambda mesh: subdivide(mesh, 0.4, 1), simplified])
def test_a_copy_meshed_anew_is_the_same(remeshed: Callable[[Mesh], Mesh]) -> None:
    assert between(PERSON, moved(remeshed(PERSON))).kinship() == "same"


def test_another_pose_of_one_body_is_no_copy() -> None:
    for pose in (1, 2):
        found = between(PERSON, make_person(0, pose))
        assert found.residual > 2.0 * RESIDUAL
        assert found.kinship() is None


def test_points_that_correspond_settle_what_the_axes_leave_open() -> None:
    """A cube's axes are tied, and one corner cut away tells its turns apart."""
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    cube[7] = [0.6, 0.7, 0.8]
    mesh = Mesh(cube, np.array(faces))
    copy = moved(mesh, scale=3.0, seed=5)
    found = align(surface_samples(mesh), surface_samples(copy), (mesh.vertices, copy.vertices))
    assert found.residual < 1e-6
    assert found.kinship() == "scaled"
    assert found.scale == pytest.approx(3.0)
