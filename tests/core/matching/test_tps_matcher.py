"""The paper's comparison one way, against a plain computation of its definitions."""

import numpy as np
import pytest

from core.matching.match_records import embedding_key
from core.matching.tps_matcher import TpsMatcher, spline_search
from core.parameters import PAPER
from tests.core.matching.clouds import cloud, embedded

SETTINGS = {
    "paper": PAPER,
    "progressive": PAPER.with_values(
        spectral={"dimensions": 5}, matching={"sign_starts": True, "kept_starts": 3, "stiffness": 100.0}
    ),
}


def prepared(embedding, parameters):
    return TpsMatcher(parameters).prepare(embedding, embedding_key(embedding))


def domain(seed, m, parameters):
    points = cloud(np.random.default_rng(seed), m, parameters.spectral.dimensions)
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
    points = cloud(np.random.default_rng(1), 60, 3)
    shape = prepared(embedded([points], 40), PAPER)
    assert shape.samples == 40
    (found,) = shape.domains
    assert np.array_equal(found.points, points[:40])
    assert found.operators.shape == (1, 40, 40)
    assert shape.nbytes == found.points.nbytes + found.operators.nbytes
