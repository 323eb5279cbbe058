"""Affinities, their leading eigenpairs, and the embedding of the samples."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform

from core.errors import ParameterError
from core.spectral import affinity as module
from core.spectral.affinity import (
    distance_affinity,
    gaussian_affinity,
    leading_eigenpairs,
    oriented,
    sampled_eigenpairs,
)
from core.spectral.spectral_embedding import affinity_signature, laplacian_signature, spectral_coordinates


def distances(count=40, seed=0):
    return squareform(pdist(np.random.default_rng(seed).normal(size=(count, 3))))


def symmetric_matrix(count=30, seed=0):
    matrix = np.random.default_rng(seed).normal(size=(count, count))
    return 0.5 * (matrix + matrix.T)


@pytest.mark.parametrize("width", [0.3, 1.0])
def test_gaussian_affinity_entry_by_entry(width):
    table = distances()
    affinity = gaussian_affinity(table, width)
    spread = width * pdist(np.random.default_rng(0).normal(size=(40, 3))).mean()
    for i, j in ((0, 1), (3, 7), (39, 12)):
        assert affinity[i, j] == pytest.approx(np.exp(-(table[i, j] ** 2) / (2.0 * spread**2)))
    np.testing.assert_array_equal(np.diag(affinity), 1.0)
    np.testing.assert_array_equal(affinity, affinity.T)
    assert np.linalg.eigvalsh(affinity).min() > -1e-12


@pytest.mark.parametrize("width", [0.0, -1.0, float("nan")])
def test_a_width_that_is_not_positive(width):
    with pytest.raises(ParameterError):
        gaussian_affinity(distances(), width)


def test_distance_affinity_entry_by_entry():
    table = np.array([[0.0, 1.0, 2.0], [1.0, 0.0, 3.0], [2.0, 3.0, 0.0]])
    expected = np.array([[1.0, 0.5, 1.0], [0.5, 1.0, 1.5], [1.0, 1.5, 1.0]])
    np.testing.assert_allclose(distance_affinity(table), expected)
    np.testing.assert_array_equal(np.diag(table), 0.0)


@pytest.mark.parametrize("factor", [1e-3, 40.0])
def test_affinities_do_not_know_the_scale(factor):
    table = distances()
    np.testing.assert_allclose(gaussian_affinity(factor * table, 0.5), gaussian_affinity(table, 0.5))
    np.testing.assert_allclose(distance_affinity(factor * table), distance_affinity(table))


def test_leading_eigenpairs_are_the_largest_by_magnitude():
    matrix = symmetric_matrix()
    values, vectors = leading_eigenpairs(matrix, 8)
    every = np.linalg.eigvalsh(matrix)
    expected = every[np.argsort(-np.abs(every))][:8]
    assert (expected < 0.0).any()
    assert (expected > 0.0).any()
    np.testing.assert_allclose(values, expected)
    np.testing.assert_allclose(matrix @ vectors, vectors * values, atol=1e-10)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(8), atol=1e-12)
    assert ((vectors**3).sum(axis=0) > 0.0).all()


@pytest.mark.parametrize("make", [symmetric_matrix, lambda: gaussian_affinity(distances(), 0.5)])
def test_the_sparse_solver_agrees_with_the_dense_one(make, monkeypatch):
    matrix = make()
    dense = leading_eigenpairs(matrix, 6)
    monkeypatch.setattr(module, "SPARSE_FROM", 0)
    sparse = leading_eigenpairs(matrix, 6)
    np.testing.assert_allclose(sparse[0], dense[0], rtol=1e-9)
    np.testing.assert_allclose(sparse[1], dense[1], atol=1e-7)


def test_the_order_of_the_samples_does_not_choose_a_sign():
    affinity = gaussian_affinity(distances(), 0.5)
    order = np.random.default_rng(1).permutation(40)
    _, vectors = leading_eigenpairs(affinity, 6)
    _, moved = leading_eigenpairs(affinity[np.ix_(order, order)], 6)
    np.testing.assert_allclose(moved, vectors[order], atol=1e-9)


def test_a_vector_that_leans_the_wrong_way_is_turned():
    vectors = np.array([[2.0, -2.0, 1.0], [-1.0, 1.0, -0.5]])
    expected = np.array([[2.0, 2.0, 1.0], [-1.0, -1.0, -0.5]])
    np.testing.assert_array_equal(oriented(np.array([3.0, 2.0, 1.0]), vectors, 3), expected)


def test_an_odd_vector_is_turned_by_its_first_large_row():
    odd = np.array([0.1, -0.7, 0.7, -0.1])[:, None]
    for sign in (-1.0, 1.0):
        np.testing.assert_allclose(oriented(np.ones(1), sign * odd, 1), -odd)


@pytest.mark.parametrize("seed", range(5))
def test_vectors_of_equal_eigenvalues_do_not_hang_on_how_they_were_mixed(seed):
    rng = np.random.default_rng(seed)
    vectors = np.linalg.qr(rng.normal(size=(40, 6)))[0]
    values = np.array([5.0, 3.0, 3.0, 3.0, 2.0, 1.0])
    expected = oriented(values, vectors, 6)
    np.testing.assert_allclose(expected.T @ expected, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(expected @ expected.T, vectors @ vectors.T, atol=1e-12)
    mixed = vectors.copy()
    mixed[:, 1:4] = vectors[:, 1:4] @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    mixed *= [1.0, 1.0, 1.0, 1.0, -1.0, -1.0]
    np.testing.assert_allclose(oriented(values, mixed, 6), expected, atol=1e-12)
    np.testing.assert_allclose(oriented(values, mixed, 3), expected[:, :3], atol=1e-12)


@pytest.mark.parametrize("power", [-0.5, 0.0, 0.5, 1.0])
def test_coordinates_are_centred_and_of_unit_radius(power):
    values, vectors = leading_eigenpairs(gaussian_affinity(distances(), 0.5), 6)
    points = spectral_coordinates(values, vectors, power)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    assert (points**2).sum(axis=1).mean() == pytest.approx(1.0)
    centred = vectors - vectors.mean(axis=0)
    ratio = points / centred
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[0], ratio.shape), rtol=1e-6)
    np.testing.assert_allclose(ratio[0] / ratio[0, 0], (values / values[0]) ** power, rtol=1e-6)


def test_power_one_half_restores_points_from_their_inner_products():
    """Classical scaling: the eigenvectors of the centred inner products are the points, but for a turn."""
    points = np.random.default_rng(2).normal(size=(25, 3)) * [3.0, 2.0, 1.0]
    points -= points.mean(axis=0)
    found = spectral_coordinates(*leading_eigenpairs(points @ points.T, 3), 0.5)
    radius = np.sqrt((points**2).sum(axis=1).mean())
    np.testing.assert_allclose(pdist(found), pdist(points) / radius, rtol=1e-9)


def test_tapered_weights_are_what_the_eigenvalues_have_over_the_first_left_out():
    values, vectors = leading_eigenpairs(gaussian_affinity(distances(), 0.5), 6)
    points = spectral_coordinates(values, vectors[:, :5], 0.5, taper=True)
    weights = np.sqrt(values[:5] - values[5])
    expected = (vectors[:, :5] - vectors[:, :5].mean(axis=0)) * weights
    scale = points[0, 0] / expected[0, 0]
    np.testing.assert_allclose(points, expected * scale, rtol=1e-9)


@pytest.mark.parametrize("power", [0.5, -0.5])
def test_a_swap_at_the_cut_hardly_changes_tapered_coordinates(power):
    """Two vectors whose eigenvalues cross at the cut: plain coordinates jump, tapered ones do not."""
    vectors = np.linalg.qr(np.random.default_rng(3).normal(size=(40, 4)))[0]
    values = np.array([9.0, 5.0, 2.001, 2.0]) if power > 0 else np.array([1.0, 2.0, 3.0, 3.001])
    swapped = vectors[:, [0, 1, 3, 2]]

    def jump(taper):
        one = spectral_coordinates(values, vectors[:, :3], power, taper=taper)
        other = spectral_coordinates(values, swapped[:, :3], power, taper=taper)
        return np.sqrt(((one - other) ** 2).sum(axis=1).mean())

    assert jump(taper=True) < 0.05 < 0.4 < jump(taper=False)


def test_tapered_coordinates_keep_a_column_whose_eigenvalue_is_repeated_at_the_cut():
    vectors = np.linalg.qr(np.random.default_rng(4).normal(size=(40, 4)))[0]
    points = spectral_coordinates(np.array([4.0, 2.0, 1.0, 1.0]), vectors[:, :3], 0.5, taper=True)
    widths = np.linalg.norm(points, axis=0)
    assert 0.0 < widths[2] < 2e-3 * widths[0]


def test_negative_eigenvalues_count_by_magnitude():
    values, vectors = leading_eigenpairs(symmetric_matrix(), 5)
    np.testing.assert_array_equal(
        spectral_coordinates(values, vectors, 0.5), spectral_coordinates(np.abs(values), vectors, 0.5)
    )


def test_signature_of_the_identity_and_of_the_constant_kernel():
    identity = affinity_signature(leading_eigenpairs(np.eye(50), 7)[0] / 50)
    np.testing.assert_allclose(identity, -np.log(50.0) / np.sqrt(7.0))
    constant = affinity_signature(leading_eigenpairs(np.ones((50, 50)), 3)[0] / 50)
    np.testing.assert_allclose(constant, np.log([1.0, 1e-6, 1e-6]) / np.sqrt(3.0), atol=1e-12)


def test_signature_does_not_know_the_scale_or_the_number_of_copies():
    table = distances()

    def signature(distance):
        affinity = gaussian_affinity(distance, 0.5)
        return affinity_signature(leading_eigenpairs(affinity, 6)[0] / len(affinity))

    np.testing.assert_allclose(signature(7.0 * table), signature(table))
    kernel = gaussian_affinity(table, 0.5)
    once = affinity_signature(leading_eigenpairs(kernel, 6)[0] / 40)
    thrice = affinity_signature(leading_eigenpairs(np.tile(kernel, (3, 3)), 6)[0] / 120)
    np.testing.assert_allclose(thrice, once)


def test_laplacian_signature():
    values = np.array([2.0, 2.0, 6.0, 12.0])
    found = laplacian_signature(values, 5.0)
    np.testing.assert_allclose(found, np.log([10.0, 10.0, 30.0, 60.0]) / 2.0)
    # Nine times as long: eigenvalues fall, and the area rises, by the square.
    np.testing.assert_allclose(laplacian_signature(values / 81.0, 81.0 * 5.0), found)
    assert np.isfinite(laplacian_signature(np.array([0.0, 1.0, 2.0]), 5.0)).all()
    assert affinity_signature(np.empty(0)).shape == laplacian_signature(np.empty(0), 5.0).shape == (0,)


def test_sampled_eigenpairs_are_the_operator_squared_by_quadrature():
    """On all points as samples, each with the same share, they are the eigenpairs of the affinity over m."""
    affinity = gaussian_affinity(distances(), 1.5)
    count = len(affinity)
    values, vectors = sampled_eigenpairs(affinity, np.full(count, 1.0 / count), 5)
    expected, functions = leading_eigenpairs(affinity, 5)
    np.testing.assert_allclose(values, np.abs(expected) / count, rtol=1e-9)
    np.testing.assert_allclose(vectors, functions, atol=1e-6)


def test_the_constant_affinity_has_the_value_one_whatever_the_shares():
    shares = np.random.default_rng(1).dirichlet(np.ones(30))
    values, vectors = sampled_eigenpairs(np.ones((80, 30)), shares, 3)
    np.testing.assert_allclose(values, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(vectors[:, 0], 80.0**-0.5, rtol=1e-9)


def test_sampled_eigenvalues_hardly_hang_on_which_samples_are_drawn():
    """A circle: the kernel's eigenvalues are known from all its points; 40 uneven samples find them."""
    angles = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)

    def kernel(columns):
        gaps = np.abs(angles[:, None] - columns)
        return np.exp(-0.5 * np.minimum(gaps, 2.0 * np.pi - gaps) ** 2)

    truth = np.sort(np.linalg.eigvalsh(kernel(angles)))[::-1][:5] / 400
    for seed in range(3):
        drawn = np.sort(np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 40))
        gaps = np.diff(np.r_[drawn[-1] - 2.0 * np.pi, drawn, drawn[0] + 2.0 * np.pi])
        shares = (gaps[:-1] + gaps[1:]) / (4.0 * np.pi)
        values, _ = sampled_eigenpairs(kernel(drawn), shares, 5)
        np.testing.assert_allclose(values, truth, rtol=0.05)
        between = np.abs(drawn[:, None] - drawn)
        plain = np.linalg.eigvalsh(np.exp(-0.5 * np.minimum(between, 2.0 * np.pi - between) ** 2))
        assert np.abs(plain[::-1][:5] / 40 / truth - 1.0).max() > 3.0 * np.abs(values / truth - 1.0).max()


def test_the_width_of_an_uneven_sampling_is_that_of_the_surface():
    table = distances()
    shares = np.random.default_rng(2).dirichlet(np.ones(len(table)))
    mean = (table @ shares).mean()
    np.testing.assert_allclose(
        gaussian_affinity(table, 0.7, shares), np.exp(-(table**2) / (2.0 * (0.7 * mean) ** 2)), rtol=1e-12
    )
