"""Products of small matrices, which take BLAS longer to call and to copy than to multiply."""

import numpy as np

from core.arrays import Float32s
from core.matching.kernels.simd import SIMD_WIDTH, TILE_ROWS, product_tile
from core.numerics.compilation import kernel


@kernel
def product(left: Float32s, right: Float32s, out: Float32s) -> None:
    """Write the product of two matrices, left @ right.

    Parameters
    ----------
    left : float32, shape (m, at least k), contiguous
        Later columns than the first k are not read; k >= 1.
    right : float32, shape (k, n), contiguous
    out : float32, shape (m, n), contiguous
        Written.
    """
    _product(left, left.shape[1], 1, right, out)


@kernel
def cross_product(left: Float32s, right: Float32s, out: Float32s) -> None:
    """Write the product of a transposed matrix and another, left.T @ right.

    Parameters
    ----------
    left : float32, shape (k, at least m), contiguous
        Later columns than the first m are not read; k >= 1.
    right : float32, shape (k, n), contiguous
    out : float32, shape (m, n), contiguous
        Written.
    """
    _product(left, 1, left.shape[1], right, out)


@kernel
def _product(left: Float32s, down: int, across: int, right: Float32s, out: Float32s) -> None:
    """Write the product whose left matrix has its entry (i, c) at the place i down + c across of `left`."""
    m, n = out.shape
    k = len(right)
    if m < TILE_ROWS or n < SIMD_WIDTH:
        entries = left.reshape(left.size)
        out[:] = np.float32(0.0)
        for i in range(m):
            for c in range(k):
                for j in range(n):
                    out[i, j] += entries[i * down + c * across] * right[c, j]
        return
    # The last part of the rows, and that of the columns, overlaps the one before.
    for i in range(0, m, TILE_ROWS):
        row = min(i, m - TILE_ROWS)
        for j in range(0, n, SIMD_WIDTH):
            column = min(j, n - SIMD_WIDTH)
            product_tile(out, row * n + column, n, left, row * down, down, across, right, column, n, k)
