"""Products of small matrices against NumPy's."""

import numpy as np
import pytest

from core.matching.kernels.matrix_product import cross_product, product
from core.matching.kernels.simd import SIMD_WIDTH, TILE_ROWS


def drawn(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("k", [1, 2, 10, 33])
@pytest.mark.parametrize("n", [1, SIMD_WIDTH - 1, SIMD_WIDTH, SIMD_WIDTH + 1, 100])
@pytest.mark.parametrize("m", [1, TILE_ROWS - 1, TILE_ROWS, TILE_ROWS + 1, 64])
def test_the_products_are_numpy_s(m: int, n: int, k: int) -> None:
    rng = np.random.default_rng(m * n * k)
    right, found = drawn(rng, k, n), np.full((m, n), np.nan, dtype=np.float32)
    # Further columns of the left matrix are not read.
    left = np.full((m, k + 3), np.nan, dtype=np.float32)
    left[:, :k] = drawn(rng, m, k)
    product(left, right, found)
    assert found == pytest.approx(left[:, :k].astype(np.float64) @ right, abs=1e-5)
    turned = np.full((k, m + 3), np.nan, dtype=np.float32)
    turned[:, :m] = left[:, :k].T
    found[:] = np.nan
    cross_product(turned, right, found)
    assert found == pytest.approx(left[:, :k].astype(np.float64) @ right, abs=1e-5)
