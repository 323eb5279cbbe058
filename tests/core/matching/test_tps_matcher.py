"""The paper's matcher: its search against its definition and on planted answers, its comparison one way."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from core.matching.match_records import embedding_key
from core.matching.quantised_points import rounded
from core.matching.thin_plate_spline import mean_pair_distance, smoother, spline_operators
from core.matching.tps_matcher import TpsMatcher, spline_search
from core.parameters import PAPER
from tests.core.matching.clouds import cloud, embedded


def search(points, targets, operators, starts, kept, start_rounds, step_rounds):
    return spline_search(
        points,
        targets,
        operators,
        starts=starts,
        kept_starts=kept,
        start_iterations=start_rounds,
        step_iterations=step_rounds,
    )


def correlation(points, targets):
    x, y = points - points.mean(axis=0), targets - targets.mean(axis=0)
    return np.abs((x * y).sum(axis=0)).sum() / np.sqrt((x**2).sum() * (y**2).sum())


def defined(points, targets, operators, starts, kept, start_rounds, step_rounds):
    """The search by its definition: a tree's nearest neighbours, matrix products, NumPy's correlation."""
    first, k_all = 3, points.shape[1]
    begun = []
    for start in range(starts):
        signs = [-1.0 if (start >> c) & 1 else 1.0 for c in range(first)]
        matches = cKDTree(targets[:, :first]).query(points[:, :first] * signs)[1]
        for _ in range(start_rounds):
            matches = cKDTree(targets[:, :first]).query(operators[0] @ targets[matches, :first])[1]
        begun.append((correlation(points[:, :first], targets[matches, :first]), start, matches))
    ended = []
    for _, _, kept_matches in sorted(begun, key=lambda one: (-one[0], one[1]))[:kept]:
        matches = kept_matches
        for k in range(first + 1, k_all + 1):
            for _ in range(step_rounds):
                matches = cKDTree(targets[:, :k]).query(operators[k - first] @ targets[matches, :k])[1]
        ended.append((correlation(points, targets[matches]), matches))
    return max(ended, key=lambda one: one[0])[1]


@pytest.mark.parametrize("sign_starts", [True, False])
@pytest.mark.parametrize(("m", "n"), [(40, 40), (30, 45), (45, 30)])
@pytest.mark.parametrize("k", [3, 4, 5, 6])
def test_the_search_is_its_definition(k, m, n, sign_starts):
    how = (8 if sign_starts else 1, 3, 4, 2)
    for seed in range(3):
        points, targets = cloud(seed, m, k), cloud(100 + seed, n, k)
        operators = spline_operators(points.astype(np.float64), 3, 100.0)
        expected = defined(*(one.astype(np.float64) for one in (points, targets, operators)), *how)
        found = search(points, targets, operators, *how)
        assert found.shape == (m,)
        assert (found == expected).all()


@pytest.mark.parametrize(
    ("signs", "starts", "kept"),
    [((1, 1, 1, -1, -1), 8, 3), ((-1, 1, -1, 1, -1), 8, 3), ((-1,) * 5, 8, 3), ((1, 1, 1, -1, -1), 1, 1)],
)
def test_a_permutation_with_flipped_signs_is_found_by_one_start_where_no_first_sign_differs(
    signs, starts, kept
):
    points = cloud(7, 50, 5)
    order = np.random.default_rng(8).permutation(50)
    targets = np.ascontiguousarray((points * np.float32(signs))[order])
    operators = spline_operators(points.astype(np.float64), 3, 100.0)
    found = search(points, targets, operators, starts, kept, 5, 3)
    assert (order[found] == np.arange(50)).all()


def test_three_points_beside_each_target_are_all_matched_to_it():
    targets = cloud(11, 20, 4)
    beside = 1e-4 * np.random.default_rng(12).normal(size=(60, 4))
    points = (np.tile(targets, (3, 1)) + beside).astype(np.float32)
    operators = spline_operators(points.astype(np.float64), 3, 100.0)
    found = search(points, targets, operators, 8, 8, 5, 3)
    assert (found == np.arange(60) % 20).all()


@pytest.mark.parametrize("stiffness", [0.01, 1.0, 100.0])
def test_each_stage_is_the_spline_in_its_own_dimensions(stiffness):
    points = cloud(2, 30, 5).astype(np.float64)
    operators = spline_operators(points, 3, stiffness)
    assert (operators.shape, operators.dtype) == ((3, 30, 30), np.float32)
    for stage, operator in enumerate(operators):
        expected = smoother(points[:, : 3 + stage], stiffness * mean_pair_distance(points))
        assert operator == pytest.approx(expected, abs=1e-6)


SETTINGS = {
    "paper": PAPER,
    "progressive": PAPER.with_values(
        spectral={"dimensions": 5}, matching={"sign_starts": True, "kept_starts": 3, "stiffness": 100.0}
    ),
}


def prepared(embedding, parameters):
    return TpsMatcher(parameters).prepare(embedding, embedding_key(embedding))


def domain(seed, m, parameters):
    points = cloud(seed, m, parameters.spectral.dimensions)
    return prepared(embedded([points], m), parameters).domains[0]


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize(("m", "n"), [(40, 40), (30, 50), (50, 25)])
def test_the_comparison_is_the_plain_one(name, m, n):
    parameters = SETTINGS[name]
    first, second = domain(m, m, parameters), domain(100 + n, n, parameters)
    matches = spline_search(
        first.points,
        second.points,
        first.operators.astype(np.float64),
        starts=8 if parameters.matching.sign_starts else 1,
        kept_starts=parameters.matching.kept_starts,
        start_iterations=parameters.matching.start_iterations,
        step_iterations=parameters.matching.step_iterations,
    )
    found = TpsMatcher(parameters).match_one_way(first, second)
    assert np.array_equal(found.matches, matches)
    y = second.points[matches]
    x = first.operators[-1].astype(np.float64) @ y
    distances = np.sqrt(((x - y) ** 2).sum(axis=1))
    assert found.distances == pytest.approx(distances, abs=1e-9)
    assert found.scores[0] == pytest.approx(
        ((x - x.mean(axis=0)) * (y - y.mean(axis=0))).sum()
        / (m * np.sqrt(x.var(axis=0).sum() * y.var(axis=0).sum()))
    )
    assert found.scores[1] == pytest.approx(np.sqrt((distances**2).sum()) / m)
    radii = [np.sqrt(((c - c.mean(axis=0)) ** 2).sum(axis=1)).mean() for c in (x, second.points)]
    near = distances <= 0.05 * sum(radii) / 2
    nearest = {j: min(np.flatnonzero(matches == j), key=lambda i: distances[i]) for j in set(matches)}
    effective = [bool(near[i]) and nearest[matches[i]] == i for i in range(m)]
    assert found.effective.tolist() == effective
    assert found.scores[2] == pytest.approx(sum(effective) / min(m, n))


def test_a_domain_is_the_samples_alone():
    points = cloud(1, 60, 3)
    shape = prepared(embedded([points], 40), PAPER)
    assert shape.samples == 40
    (found,) = shape.domains
    assert np.array_equal(found.points, rounded(points, embedded([points], 40).regions)[:40])
    assert found.operators.shape == (1, 40, 40)
    assert shape.nbytes == found.points.nbytes + found.operators.nbytes
