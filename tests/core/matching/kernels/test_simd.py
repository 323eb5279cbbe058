"""Products of small matrices against NumPy's, squared distances to the last bit, arrays that are refused."""

import numpy as np
import pytest
from numba import TypingError

from core.matching.kernels.simd import (
    SIMD_WIDTH,
    SUMS,
    TILE_ROWS,
    product,
    squared_distance,
    symmetric_product,
)


def drawn(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("k", [1, 10])
@pytest.mark.parametrize("n", [SIMD_WIDTH, 2 * SIMD_WIDTH])
@pytest.mark.parametrize("m", [1, TILE_ROWS - 1, TILE_ROWS, TILE_ROWS + 1])
def test_the_product_is_numpy_s(m: int, n: int, k: int) -> None:
    rng = np.random.default_rng(m * n * k)
    right, found = drawn(rng, k, n), np.full((m, n), np.nan, dtype=np.float32)
    # Further columns of the left matrix are not read.
    left = np.full((m, k + 3), np.nan, dtype=np.float32)
    left[:, :k] = drawn(rng, m, k)
    product(left, right, found)
    assert found == pytest.approx(left[:, :k].astype(np.float64) @ right, abs=1e-5)


@pytest.mark.parametrize("low", [0, SIMD_WIDTH])
@pytest.mark.parametrize("m", [1, TILE_ROWS - 1, TILE_ROWS, TILE_ROWS + 1, 30])
def test_the_product_of_a_symmetric_matrix_is_numpy_s(m: int, low: int) -> None:
    rng = np.random.default_rng(m + low)
    lower, right = np.tril(drawn(rng, m, m), -1), drawn(rng, m, 2 * SIMD_WIDTH)
    found = np.full((m, SIMD_WIDTH), np.nan, np.float32)
    symmetric_product(lower, right, low, found)
    expected = (lower + lower.T).astype(np.float64) @ right[:, low : low + SIMD_WIDTH]
    assert found == pytest.approx(expected, abs=1e-5)


def plain(one, other):
    """Four sums, each of every fourth column, and the rest in the first."""
    sums = np.zeros(SUMS, dtype=np.float32)
    whole = len(one) - len(one) % SUMS
    squares = (one - other) ** 2
    for start in range(0, whole, SUMS):
        sums += squares[start : start + SUMS]
    for square in squares[whole:]:
        sums[0] += square
    return (sums[0] + sums[1]) + (sums[2] + sums[3])


@pytest.mark.parametrize("k", [1, 3, 4, 7, 20, 24])
def test_it_is_that_of_the_two_rows(k):
    rng = np.random.default_rng(k)
    points, others = (rng.standard_normal((n, k), dtype=np.float32) for n in (5, 8))
    for i in range(5):
        for j in range(8):
            assert squared_distance(points, i, others, j) == plain(points[i], others[j])


def test_the_second_array_may_have_more_columns():
    rng = np.random.default_rng(0)
    points, others = (rng.standard_normal((4, k), dtype=np.float32) for k in (8, 11))
    assert squared_distance(points, 2, others, 3) == plain(points[2], others[3, :8])


def test_rows_that_are_not_contiguous_are_refused():
    points = np.zeros((8, 8), dtype=np.float32)
    for other in (points.T, points[:, ::2], points.astype(np.float64)):
        with pytest.raises(TypingError, match="contiguous"):
            squared_distance(points[:, :4].copy(), 0, other, 0)
