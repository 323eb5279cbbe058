"""The orthogonal map between two paired clouds: Procrustes by a polar factor of matrix products alone."""

import math

import numpy as np

from core.arrays import Float32s
from core.matching.kernels.simd import SIMD_WIDTH, product_row
from core.numerics.compilation import constant, kernel

ROUGH = constant(
    np.array(
        [
            (8.458838, -24.8550361, 18.2648487),
            (4.2136983, -3.0980635, 0.5703304),
            (4.1435814, -3.0500064, 0.5649399),
            (3.8766156, -2.864991, 0.5442039),
            (3.1194696, -2.3174629, 0.4831764),
            (2.1571445, -1.5274061, 0.3980536),
            (1.876218, -1.2468613, 0.3706892),
        ],
        dtype=np.float32,
    )
)
"""Polynomials a x + b x^3 + c x^5, rows (a, b, c), that one after another take [3e-4, 1] to within 3e-4 of 1.

Each is the best one on the interval that the ones before leave, made wider by half a percent for rounding
(Amsel et al. 2025, The Polar Express). For maps whose pairs still change.
"""

EXACT = constant(
    np.array(
        [
            (8.4675707, -24.8891883, 18.2917509),
            (4.2285156, -3.1081925, 0.5714667),
            (4.2046087, -3.0918455, 0.5696329),
            (4.1069739, -3.0248317, 0.5621167),
            (3.7503418, -2.776237, 0.5342698),
            (2.866187, -2.123686, 0.461817),
            (2.0249173, -1.4006321, 0.3852356),
            (1.8714169, -1.2417401, 0.3703295),
            (1.875, -1.25, 0.375),
        ],
        dtype=np.float32,
    )
)
"""As `ROUGH`, from [1e-4, 1] to within rounding of 1, for maps that are scored."""


@kernel
def nearest_rotation(matrix: Float32s, steps: Float32s, rotation: Float32s, workspace: Float32s) -> float:
    """Write the polar factor U V^T of a matrix U S V^T; return its trace with the matrix, the sum of S.

    By odd polynomials of the matrix over its Frobenius norm: X <- a X + X (b G + c G^2), G = X^T X, each of
    which brings the singular values nearer to 1. Smaller singular values than the steps are made for come out
    between 0 and 1, continuously: rounding does not settle a direction that the matrix does not determine.

    Parameters
    ----------
    matrix : float32, shape (k, w)
        Padded with zeros to a multiple w of SIMD_WIDTH columns.
    steps : float32, shape (n, 3)
        `ROUGH` or `EXACT`.
    rotation : float32, shape (k, w)
        Written.
    workspace : float32, shape (3, k, w)
        Written.
    """
    k, width = matrix.shape
    # The Frobenius norm, in a sum for each column.
    squares = np.zeros(width, dtype=np.float32)
    for i in range(k):
        for j in range(width):
            squares[j] += matrix[i, j] * matrix[i, j]
    size = np.float32(0.0)
    for j in range(k):
        size += squares[j]
    scale = np.float32(1.0 / math.sqrt(size)) if size > 0.0 else np.float32(0.0)
    # X, of singular values at most 1, in two arrays by turns.
    current = rotation
    following = workspace[0]
    gram = workspace[1]
    factor = workspace[2]
    for i in range(k):
        for j in range(width):
            current[i, j] = matrix[i, j] * scale
    for step in range(len(steps)):
        a, b, c = steps[step]
        # G = X^T X; as the next products, a vector of each row at a time.
        for i in range(k):
            for place in range(i * width, i * width + width, SIMD_WIDTH):
                column = place - i * width
                product_row(gram, place, 0.0, current, 1.0, current, i, width, k, current, column, width)
        # The polynomial of G, without its constant.
        for i in range(k):
            for place in range(i * width, i * width + width, SIMD_WIDTH):
                column = place - i * width
                product_row(factor, place, b, gram, c, gram, i * width, 1, k, gram, column, width)
        # The next X: a X + X (b G + c G^2).
        for i in range(k):
            for place in range(i * width, i * width + width, SIMD_WIDTH):
                column = place - i * width
                product_row(
                    following, place, a, current, 1.0, current, i * width, 1, k, factor, column, width
                )
        current, following = following, current
    # After an odd number of steps X is in the other array.
    if len(steps) % 2:
        for i in range(k):
            for j in range(width):
                rotation[i, j] = current[i, j]
    # The trace with the matrix, in a sum for each column.
    for j in range(width):
        squares[j] = 0.0
    for i in range(k):
        for j in range(width):
            squares[j] += rotation[i, j] * matrix[i, j]
    trace = np.float32(0.0)
    for j in range(k):
        trace += squares[j]
    return float(trace)


@kernel
def fit_rotation(
    covariance: Float32s, first: Float32s, second: Float32s, steps: Float32s, rotation: Float32s
) -> float:
    """Write the orthogonal map, one for each block of columns, and return the correlation after it.

    Parameters
    ----------
    covariance : float32, shape (b k, b k)
        Cross-covariance of paired points, in b spectral domains of k dimensions side by side.
    first, second : float32, shape (b,)
        Their centred square sums, over each domain.
    steps : float32, shape (n, 3)
        See `nearest_rotation`.
    rotation : float32, shape (b k, b k)
        Written where blocks meet themselves: points of the first times it lie on those of the second.

    Returns
    -------
    float
        The mean over the domains of the trace over the root of the product of the square sums; a domain where
        either is one point counts 0.
    """
    blocks = len(first)
    k = covariance.shape[0] // blocks
    width = (k + SIMD_WIDTH - 1) // SIMD_WIDTH * SIMD_WIDTH
    padded = np.zeros((k, width), dtype=np.float32)
    factor = np.empty((k, width), dtype=np.float32)
    workspace = np.zeros((3, k, width), dtype=np.float32)
    score = 0.0
    for block in range(blocks):
        # The block's covariance, padded to whole vectors, and its polar factor.
        low = block * k
        for i in range(k):
            for j in range(k):
                padded[i, j] = covariance[low + i, low + j]
        trace = nearest_rotation(padded, steps, factor, workspace)
        for i in range(k):
            for j in range(k):
                rotation[low + i, low + j] = factor[i, j]
        # The correlation after the map.
        size = math.sqrt(max(0.0, first[block] * second[block]))
        if size > 0.0:
            score += min(1.0, trace / size) / blocks
    return score
