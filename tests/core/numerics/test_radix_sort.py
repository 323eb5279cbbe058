"""Sorting by digits against NumPy's."""

import numpy as np
import pytest

from core.numerics.radix_sort import lexical_order, sortable

DRAW = np.random.default_rng(0)
COLUMNS = {
    "few integers": lambda n: DRAW.integers(0, 5, n),
    "integers of one digit more": lambda n: DRAW.integers(2040, 2060, n),
    "all integers": lambda n: DRAW.integers(0, 2**63 - 1, n),
    "nought": lambda n: np.zeros(n, dtype=np.int64),
    "floats": lambda n: DRAW.normal(size=n),
    "floats of all sizes": lambda n: DRAW.choice([-1.0, 1.0], n) * 10.0 ** DRAW.uniform(-300, 300, n),
    "few floats": lambda n: DRAW.choice([-np.inf, -1.5, -0.0, 0.0, 5e-324, 2.0, np.inf], n),
}


@pytest.mark.parametrize("first", COLUMNS)
@pytest.mark.parametrize("count", [1, 2, 3000])
def test_one_column(first, count):
    column = COLUMNS[first](count)
    np.testing.assert_array_equal(lexical_order(column), np.argsort(column, kind="stable"))


@pytest.mark.parametrize("first", ["few integers", "few floats"])
@pytest.mark.parametrize("second", COLUMNS)
def test_several_columns(first, second):
    columns = [COLUMNS[first](2000), COLUMNS[second](2000), COLUMNS["few integers"](2000)]
    np.testing.assert_array_equal(lexical_order(*columns), np.lexsort(columns[::-1]))


def test_nothing_is_in_order():
    assert lexical_order(np.empty(0, dtype=np.int64)).shape == (0,)


def test_a_sorted_array_stays():
    column = COLUMNS["floats"](500)
    before = column.copy()
    lexical_order(column)
    np.testing.assert_array_equal(column, before)
    assert (np.diff(sortable(np.sort(column)).astype(object)) > 0).all()
