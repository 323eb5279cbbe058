"""Distances of signatures and the nearest of them, against plain NumPy."""

import numpy as np
import pytest

from core.descriptors.facts import GLOBAL_WEIGHT
from core.ranking.shortlist import global_distances, least, signature_distances, spectral_distances


@pytest.mark.parametrize("s", [1, 3, 4, 7, 50])
@pytest.mark.parametrize("n", [1, 2, 100])
def test_distances_are_the_plain_ones(n, s):
    rng = np.random.default_rng(n + s)
    query, matrix = (rng.normal(size=shape).astype(np.float32) for shape in (s, (n, s)))
    expected = np.linalg.norm(matrix.astype(np.float64) - query, axis=1)
    assert signature_distances(query, matrix) == pytest.approx(expected, rel=1e-12)
    for other in (np.asfortranarray(matrix), matrix[::-1]):
        assert signature_distances(query, other) == pytest.approx(
            np.linalg.norm(other.astype(np.float64) - query, axis=1), rel=1e-12
        )
    matrix.flags.writeable = False
    assert signature_distances(matrix[0], matrix)[0] == 0.0


def test_no_signatures_have_no_distances():
    assert signature_distances(np.zeros(5, np.float32), np.empty((0, 0), np.float32)).shape == (0,)


@pytest.mark.parametrize("kinds", [3, 1000])
@pytest.mark.parametrize("count", [1, 2, 17, 99, 100, 200])
def test_the_least_are_those_that_sorting_gives(count, kinds):
    """Of few kinds, many values are equal: those first in order are taken."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        values, order = rng.integers(kinds, size=100) / 7, rng.permutation(100)
        expected = sorted(range(100), key=lambda place: (values[place], order[place]))[:count]
        assert least(values, order, count).tolist() == expected


def test_eigenvalues_and_global_descriptors_have_a_distance_each() -> None:
    query = np.array([1.0, 2.0, 5.0, 5.0, 5.0], dtype=np.float32)
    others = np.array([[1.0, 2.0, 5.0, 2.0, 1.0], [4.0, 6.0, 5.0, 5.0, 5.0]], dtype=np.float32)
    np.testing.assert_allclose(spectral_distances(query, others), [0.0, 5.0])
    np.testing.assert_allclose(global_distances(query, others), [5.0 / GLOBAL_WEIGHT, 0.0])
