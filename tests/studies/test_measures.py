"""The measures of the studies of sampling, ablation and robustness, against cases whose answers are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from core.gallery import make_shape
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.spectral.laplace_beltrami import laplacian
from tests.core.shapes import rectangle
from tests.studies.ablation import LAST, NAMED, changes, trials, values_of
from tests.studies.robustness import TAU_CAP, TAU_VERTICES, nearest_neighbour, tau_parameters
from tests.studies.sampling import (
    BINS,
    coverage,
    distance_histogram,
    fit_residuals,
    largest_variation,
    poisson_disk,
    rebuilt_error,
    root_mean_square,
    total_variation,
)


def line(count):
    """Distances between points 0, 1, .. on a line."""
    points = np.arange(float(count))[:, None]
    return cdist(points, points)


def square(side, height=lambda x, y: 0.0 * x):
    """A square [-1, 1]^2 of side^2 vertices, lifted."""
    sheet = rectangle(2, 2, side - 1, side - 1)
    x, y = sheet.vertices[:, :2].T - 1.0
    return Mesh(np.stack([x, y, height(x, y)], axis=1), sheet.faces)


def quintic(x, y):
    return 0.3 * x**5 - 0.2 * x**2 * y**3 + x * y - 0.5 * y + 0.1


def test_histograms_of_points_on_a_line():
    # Distances 1, 1 and 2: halves of the largest, and the largest itself.
    assert distance_histogram(line(3)).tolist() == pytest.approx([0, 0, 2 / 3, 0, 1 / 3])
    # Two uniform points on [0, 1] are d apart with density 2 (1 - d).
    edges = np.linspace(0, 1, BINS + 1)
    assert distance_histogram(line(1000)) == pytest.approx(np.diff(2 * edges - edges**2), abs=2e-3)


def test_variation_is_a_distance_of_distributions():
    a, b, c = np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0.5, 0.5, 0])
    assert [total_variation(a, b), total_variation(a, c), total_variation(a, a)] == [1.0, 0.5, 0.0]
    assert largest_variation([a, c, b]) == 1.0
    assert largest_variation([a]) == 0.0


def test_a_polynomial_is_fitted_exactly_by_its_degree_and_no_less():
    points = square(20, quintic).vertices
    assert root_mean_square(fit_residuals(points, 5)) < 1e-12
    assert root_mean_square(fit_residuals(points, 4)) > 1e-3
    samples = np.random.default_rng(0).permutation(len(points))[:60]
    assert root_mean_square(fit_residuals(points, 5, samples)) < 1e-10
    uneven = np.where(np.arange(len(points)) % 2 == 0, 1.0, 0.2)
    assert root_mean_square(fit_residuals(points, 5, samples, uneven)) < 1e-10


def test_weights_of_a_draw_are_those_of_least_squares():
    points = square(12, lambda x, y: np.sin(3 * x) * np.cos(2 * y)).vertices
    samples = np.arange(0, len(points), 3)
    probability = np.random.default_rng(1).uniform(0.1, 1.0, len(points))
    powers = [(i, j) for i in range(3) for j in range(3 - i)]
    basis = np.stack([points[:, 0] ** i * points[:, 1] ** j for i, j in powers], axis=1)
    root = 1.0 / np.sqrt(probability[samples])
    expected = np.linalg.lstsq(basis[samples] * root[:, None], points[samples, 2] * root, rcond=None)[0]
    found = fit_residuals(points, 2, samples, probability)
    assert found == pytest.approx(points[:, 2] - basis @ expected, abs=1e-9)


def test_coverage_of_points_on_a_line():
    gap, mean, evenness = coverage(line(9), np.ones(9), np.array([0, 2, 8]))
    # Samples 0, 2 and 8: their nearest samples are 2, 2 and 6 away.
    assert (gap, mean, evenness) == (3.0, (1 + 1 + 2 + 3 + 2 + 1) / 9, pytest.approx(2 / (10 / 3)))


def test_a_sheet_comes_back_from_its_border_and_a_roof_with_its_ridge():
    sheet, roof = square(15, lambda x, y: 0.4 * x - y), square(21, lambda x, y: 1 - np.abs(x))
    borders = [np.abs(mesh.vertices[:, :2]).max(axis=1) > 1 - 1e-9 for mesh in (sheet, roof)]
    assert rebuilt_error(*laplacian(sheet), sheet.vertices, np.flatnonzero(borders[0])) < 1e-9
    across = np.abs(roof.vertices[:, 0])
    ridge, eaves = across < 1e-9, np.flatnonzero(across > 1 - 1e-9)
    assert rebuilt_error(*laplacian(roof), roof.vertices, np.flatnonzero(borders[1] | ridge)) < 1e-9
    # From its two low edges alone it is flat, and z is off by 1 - |x|, whose mean square is 1 / 3.
    assert rebuilt_error(*laplacian(roof), roof.vertices, eaves) > np.sqrt(1 / 3) - 0.05


def test_the_changes_part_the_whole_difference_and_add_up_to_the_default():
    paper, default = values_of(PAPER), values_of(DEFAULT)
    differing = {name for name in paper if paper[name] != default[name]}
    fields = [name for change in changes() for name in change.fields]
    assert len(fields) == len(set(fields))
    assert differing <= set(fields)
    assert all(differing & set(change.fields) for change in NAMED)
    together = [trial for trial in trials() if trial.block == "together"]
    assert together[0].parameters == PAPER
    assert together[-1].parameters.fingerprint == DEFAULT.fingerprint
    assert [trial.rank_by for trial in together[-2:]] == ["cc", LAST.rank_by]


def test_perturbed_queries_without_a_score_are_errors_and_the_diagonal_is_not_read():
    labels = ["a", "a", "b", "b"]
    similarities = np.array([[9, 2, 1, 1], [2, 9, 3, 1], [1, 1, 9, 2], [0, 0, 0, 9.0]])
    scored = np.ones((4, 4), dtype=bool)
    assert nearest_neighbour({"cc": similarities}, scored, labels) == {"nn_cc": 0.5}
    scored[0] = False
    assert nearest_neighbour({"cc": similarities}, scored, labels) == {"nn_cc": 0.25}


@pytest.mark.parametrize("tau", [0.1, 0.4])
def test_samples_are_the_share_tau_of_about_so_many_vertices(tau):
    embedding = Pipeline(tau_parameters(tau)).embed(make_shape("cup", 0))
    assert len(embedding.positions) == pytest.approx(tau * TAU_VERTICES, rel=0.1)
    assert len(embedding.positions) <= TAU_CAP


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 150), st.data())
def test_poisson_disks_are_as_many_as_asked_at_least_a_radius_apart(count, data):
    wanted, random = (
        data.draw(st.integers(1, count)),
        np.random.default_rng(data.draw(st.integers(0, 10_000))),
    )
    points = random.random((count, 2))
    distances = cdist(points, points)
    samples, radius = poisson_disk(distances, wanted, random.permutation(count))
    assert len(set(samples.tolist())) == wanted
    assert (distances[np.ix_(samples, samples)][~np.eye(wanted, dtype=bool)] >= radius).all()


def test_darts_fall_in_the_order_given():
    # Four of seven points on a line can be 2 apart, from either end, and three if the middle one is first.
    assert poisson_disk(line(7), 4, np.arange(7))[0].tolist() == [0, 2, 4, 6]
    assert poisson_disk(line(7), 3, np.array([3, 0, 1, 2, 4, 5, 6]))[0].tolist() == [3, 0, 6]
    assert poisson_disk(line(7), 7, np.arange(7)[::-1])[0].tolist() == [6, 5, 4, 3, 2, 1, 0]


def test_a_poisson_disk_set_is_spread_and_leaves_no_room():
    random = np.random.default_rng(5)
    points = random.random((400, 2))
    distances = cdist(points, points)
    samples, radius = poisson_disk(distances, 60, random.permutation(400))
    # The spacing of random throws on a square is 0.6 to 0.9 of the densest packing's, 1.0746 / sqrt(m).
    assert 0.6 < radius / (1.0746 / np.sqrt(60)) < 0.9
    # Only the few left out for the number can leave a gap wider than the radius, and none twice as wide.
    assert distances[samples].min(axis=0).max() < 2.0 * radius
