"""Nearest rows both ways, beside a search tree."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from core.matching.nearest_pairs import nearest_both_ways


@pytest.mark.parametrize("scale", [1.0, 1e12, 1e-12])
def test_the_rows_are_those_of_a_tree(scale):
    rng = np.random.default_rng(4)
    ours, theirs = scale * rng.normal(size=(2500, 6)), scale * rng.normal(size=(1300, 6))
    there, back = nearest_both_ways(ours, theirs)
    np.testing.assert_array_equal(there, cKDTree(theirs).query(ours)[1])
    np.testing.assert_array_equal(back, cKDTree(ours).query(theirs)[1])


def test_rows_and_themselves():
    rows = np.random.default_rng(5).normal(size=(40, 100))
    for found in nearest_both_ways(rows, rows):
        np.testing.assert_array_equal(found, np.arange(40))
