"""The numbers about samples, against cases whose answers are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from core.mesh.mesh import Mesh
from core.spectral.laplace_beltrami import laplacian
from core.studies.sampling.measures import (
    BINS,
    coverage,
    distance_histogram,
    fit_residuals,
    largest_variation,
    rebuilt,
    rebuilt_error,
    region_shares,
    root_mean_square,
    sampled_fit_residuals,
    total_variation,
)


def line(count):
    """Distances between points 0, 1, .. on a line."""
    places = np.arange(float(count))[:, None]
    return cdist(places, places)


def grid(side, height=lambda x, y: 0.0 * x):
    """A square [-1, 1]^2 of side^2 vertices, lifted."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-1, 1, side)] * 2))
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + side + 1], axis=1),
            np.stack([corner, corner + side + 1, corner + side], axis=1),
        ]
    )
    return Mesh(np.stack([x, y, height(x, y)], axis=1), faces)


def quintic(x, y):
    return 0.3 * x**5 - 0.2 * x**2 * y**3 + x * y - 0.5 * y + 0.1


# Histograms


def test_histogram_of_three_points_on_a_line():
    # Distances 1, 1 and 2: halves of the largest, and the largest itself.
    assert distance_histogram(line(3)).tolist() == pytest.approx([0, 0, 2 / 3, 0, 1 / 3])


def test_histogram_of_many_points_on_a_line():
    # Two uniform points on [0, 1] are d apart with density 2 (1 - d).
    edges = np.linspace(0, 1, BINS + 1)
    expected = np.diff(2 * edges - edges**2)
    assert distance_histogram(line(1000)) == pytest.approx(expected, abs=0.002)


@given(st.integers(2, 40), st.integers(0, 1000), st.floats(1e-3, 1e3))
def test_histograms_sum_to_one_whatever_the_unit(count, seed, unit):
    points = np.random.default_rng(seed).random((count, 3))
    found = distance_histogram(cdist(points, points))
    assert found.shape == (BINS,)
    assert found.sum() == pytest.approx(1.0)
    assert found[-1] > 0.0
    assert distance_histogram(unit * cdist(points, points)) == pytest.approx(found, abs=2.1 / count)


shares = st.lists(st.floats(0.01, 1.0), min_size=BINS, max_size=BINS).map(lambda v: np.array(v) / sum(v))


@given(shares, shares, shares)
def test_total_variation_is_a_distance_up_to_one(a, b, c):
    assert total_variation(a, a) == 0.0
    assert total_variation(a, b) == total_variation(b, a) <= 1.0
    assert total_variation(a, c) <= total_variation(a, b) + total_variation(b, c) + 1e-12


def test_total_variation_of_known_pairs():
    assert total_variation(np.array([1.0, 0.0]), np.array([0.0, 1.0])) == 1.0
    assert total_variation(np.array([0.5, 0.5]), np.array([0.75, 0.25])) == 0.25


def test_largest_variation_is_over_all_pairs():
    one, two, three = np.array([1.0, 0.0]), np.array([0.9, 0.1]), np.array([0.6, 0.4])
    assert largest_variation([two, one, three]) == pytest.approx(0.4)
    assert largest_variation([one, one]) == 0.0
    assert largest_variation([one]) == 0.0


# The fit


@pytest.mark.parametrize("degree", [4, 5, 6])
def test_a_surface_of_degree_five_is_fitted_from_degree_five_on(degree):
    error = root_mean_square(fit_residuals(grid(30, quintic).vertices, degree))
    assert error < 1e-12 if degree >= 5 else error > 0.005


def test_two_sheets_leave_half_their_distance():
    # The best graph over a plane through z = +1 and z = -1 on the same x, y is z = 0.
    sheet, up = grid(12).vertices, np.array([0.0, 0.0, 1.0])
    both = np.concatenate([sheet + up, sheet - up])
    for degree in (1, 4, 6):
        assert np.abs(fit_residuals(both, degree)) == pytest.approx(np.ones(len(both)))


def test_no_other_polynomial_fits_better():
    random = np.random.default_rng(0)
    points = random.normal(size=(200, 3))
    best = root_mean_square(fit_residuals(points, 2))
    x, y, z = points.T
    for _ in range(50):
        a = 0.2 * random.normal(size=6)
        other = z - (a[0] + a[1] * x + a[2] * y + a[3] * x * x + a[4] * x * y + a[5] * y * y)
        assert root_mean_square(other) > best
    assert root_mean_square(fit_residuals(points, 3)) < best


def test_samples_of_a_polynomial_give_it_back_everywhere():
    points = grid(25, quintic).vertices
    samples = np.random.default_rng(3).choice(len(points), 60, replace=False)
    assert np.abs(sampled_fit_residuals(points, samples, 5)).max() < 1e-9
    assert np.abs(sampled_fit_residuals(points, samples, 6)).max() < 1e-9
    assert np.abs(sampled_fit_residuals(points, samples, 4)).max() > 0.005


def test_all_samples_give_the_best_fit_and_fewer_never_a_better_one():
    points = np.random.default_rng(4).normal(size=(300, 3))
    best = fit_residuals(points, 3)
    assert sampled_fit_residuals(points, np.arange(300), 3) == pytest.approx(best)
    for start in range(5):
        samples = np.arange(start, 300, 5)
        assert root_mean_square(sampled_fit_residuals(points, samples, 3)) > root_mean_square(best)


def test_rows_drawn_with_a_probability_weigh_its_inverse():
    # Points drawn half as often, there twice: the same normal equations as all points once.
    random = np.random.default_rng(5)
    points = random.normal(size=(40, 3))
    samples = np.concatenate([np.arange(20), np.arange(20, 40), np.arange(20, 40)])
    probability = np.repeat([0.5, 1.0], 20)
    expected = sampled_fit_residuals(points, np.concatenate([np.arange(20), samples]), 2)
    even = sampled_fit_residuals(points, samples, 2, np.repeat([0.5, 1.0], [20, 20]))
    assert even == pytest.approx(expected)
    assert sampled_fit_residuals(points, samples, 2, 0.3 * probability) == pytest.approx(even)


# Coverage and spacing


def test_spread_of_even_samples_on_a_line():
    found = coverage(line(9), np.ones(9), np.array([0, 4, 8]))
    assert (found.largest_gap, found.mean_spacing, found.evenness) == (2.0, 4.0, 1.0)
    assert found.mean_gap == pytest.approx((0 + 1 + 2 + 1 + 0 + 1 + 2 + 1 + 0) / 9)


def test_spread_of_crowded_samples():
    found = coverage(line(9), np.ones(9), np.array([0, 1, 4]))
    # To the next sample: 1, 1 and 3.
    assert found.largest_gap == 4.0
    assert found.mean_spacing == pytest.approx(5 / 3)
    assert found.evenness == pytest.approx(3 / 5)


def test_mean_gap_counts_by_area():
    areas = np.array([1.0, 1.0, 8.0])
    assert coverage(line(3), areas, np.array([0, 1])).mean_gap == pytest.approx(0.8)


def test_spread_leaves_the_distances_as_they_are():
    distances = line(5)
    coverage(distances, np.ones(5), np.arange(5))
    assert (distances == line(5)).all()


# The rebuilt surface


def border(mesh):
    return np.flatnonzero(np.abs(mesh.vertices[:, :2]).max(axis=1) > 1 - 1e-9)


def test_a_flat_sheet_comes_back_from_its_border():
    mesh = grid(15, lambda x, y: 0.4 * x - y)
    stiffness, areas = laplacian(mesh)
    assert rebuilt(stiffness, mesh.vertices, border(mesh)) == pytest.approx(mesh.vertices, abs=1e-9)
    assert rebuilt_error(stiffness, areas, mesh.vertices, border(mesh)) < 1e-9


def test_a_roof_is_cut_off_without_its_ridge_and_kept_with_it():
    mesh = grid(21, lambda x, y: 1 - np.abs(x))
    stiffness, areas = laplacian(mesh)
    ends = np.flatnonzero(np.abs(mesh.vertices[:, 0]) > 1 - 1e-9)
    ridge = np.flatnonzero(np.abs(mesh.vertices[:, 0]) < 1e-9)
    # From its two low edges alone it is flat, and z is off by 1 - |x|, whose mean square is 1/3.
    assert np.abs(rebuilt(stiffness, mesh.vertices, ends)[:, 2]).max() < 1e-9
    assert rebuilt_error(stiffness, areas, mesh.vertices, ends) > np.sqrt(1 / 3) - 0.05
    kept = np.concatenate([border(mesh), ridge])
    assert rebuilt_error(stiffness, areas, mesh.vertices, kept) < 1e-9


def test_samples_stay_and_what_is_between_never_leaves_their_range():
    mesh = grid(15, lambda x, y: np.sin(3 * x) * y)
    stiffness, areas = laplacian(mesh)
    samples = np.random.default_rng(6).choice(len(mesh.vertices), 20, replace=False)
    film = rebuilt(stiffness, mesh.vertices, samples)
    assert (film[samples] == mesh.vertices[samples]).all()
    for axis in range(3):
        inside = mesh.vertices[samples, axis]
        assert film[:, axis].min() >= inside.min() - 1e-9
        assert film[:, axis].max() <= inside.max() + 1e-9
    everything = np.arange(len(mesh.vertices))
    assert rebuilt_error(stiffness, areas, mesh.vertices, everything) == 0.0


# Regions


def test_region_shares():
    regions = np.array([0, 0, 1, 2, 2, 2])
    assert region_shares(regions, np.array([0, 3, 4, 5]), 4).tolist() == [0.25, 0.0, 0.75, 0.0]
