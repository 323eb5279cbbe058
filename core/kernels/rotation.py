"""The orthogonal map between two paired clouds: Procrustes by Newton's iteration for the polar factor."""

import math

import numpy as np
from scipy.linalg import polar

from core.compiled import kernel
from core.embedding import Float32s
from core.kernels.lanes import LANES, add_scaled
from core.mesh import Floats, Ints


@kernel
def nearest_rotation(
    matrix: Float32s, rotation: Float32s, inverse: Float32s, order: Ints, tolerance: float
) -> float:
    """Write the polar factor U V^T of a matrix U S V^T; return its trace with the matrix, the sum of S.

    Newton's iteration X <- (g X + X^-T / g) / 2 with Higham's scaling g (Higham 1986). It settles within
    six rounds or so. A pivot of nothing counts as 1e-7: in a direction that the matrix does not determine,
    any rotation is as good.

    Parameters
    ----------
    matrix : float32, shape (k, w)
        Padded with zeros to a multiple w of LANES columns.
    rotation, inverse : float32, shape (k, w)
        Written.
    order : int64, shape (k,)
        Written.
    tolerance : float
        The iteration stops when no entry changed by more; the error left is of the order of its square.
    """
    k, width = matrix.shape
    row = np.zeros(width, dtype=np.float32)
    factors = np.empty(k, dtype=np.float32)
    size = np.float32(0.0)
    for i in range(k):
        for j in range(width):
            size += matrix[i, j] * matrix[i, j]
    if size > 0.0:
        scale = np.float32(1.0 / math.sqrt(size))
        for i in range(k):
            for j in range(width):
                rotation[i, j] = matrix[i, j] * scale
    else:
        rotation[:] = 0.0
        for i in range(k):
            rotation[i, i] = 1.0
    for _ in range(30):
        for i in range(k):
            order[i] = i
            for j in range(width):
                inverse[i, j] = rotation[i, j]
        for c in range(k):
            pivot = c
            for i in range(c + 1, k):
                if abs(inverse[i, c]) > abs(inverse[pivot, c]):
                    pivot = i
            if abs(inverse[pivot, c]) < 1e-7:
                inverse[pivot, c] = 1e-7
            if pivot != c:
                order[c], order[pivot] = order[pivot], order[c]
                for j in range(width):
                    kept = inverse[c, j]
                    inverse[c, j] = inverse[pivot, j]
                    inverse[pivot, j] = kept
            share = np.float32(1.0) / inverse[c, c]
            for j in range(width):
                row[j] = inverse[c, j] * share
            # Entry c one too large: the rows need no zero written there first, for which they would wait.
            row[c] = share + np.float32(1.0)
            for i in range(k):
                factors[i] = -inverse[i, c]
            factors[c] = 0.0
            for i in range(k):
                for start in range(0, width, LANES):
                    add_scaled(inverse, i * width + start, row, start, factors[i])
            for j in range(width):
                inverse[c, j] = row[j]
            inverse[c, c] = share
        own = np.float32(0.0)
        other = np.float32(0.0)
        for i in range(k):
            for j in range(width):
                own += rotation[i, j] * rotation[i, j]
                other += inverse[i, j] * inverse[i, j]
        stretch = np.float32(0.5 * math.sqrt(math.sqrt(other / own)))
        shrink = np.float32(0.25) / stretch
        change = np.float32(0.0)
        for c in range(k):
            i = order[c]
            for j in range(k):
                entry = stretch * rotation[i, j] + shrink * inverse[j, c]
                change = max(change, abs(entry - rotation[i, j]))
                rotation[i, j] = entry
        if change < tolerance:
            break
    trace = np.float32(0.0)
    for i in range(k):
        for j in range(width):
            trace += rotation[i, j] * matrix[i, j]
    return float(trace)


@kernel
def turn(cross: Float32s, first: Float32s, second: Float32s, tolerance: float, rotation: Float32s) -> float:
    """Write the orthogonal map, one for each block of columns, and return the correlation after it.

    Parameters
    ----------
    cross : float32, shape (b k, b k)
        Centred cross-products of paired points, in b spectral domains of k dimensions side by side.
    first, second : float32, shape (b,)
        Their centred square sums, over each domain.
    tolerance : float
        Of `nearest_rotation`.
    rotation : float32, shape (b k, b k)
        Written where blocks meet themselves: points of the first times it lie on those of the second.

    Returns
    -------
    float
        The mean over the domains of the trace over the root of the product of the square sums; a domain where
        either is one point counts 0.
    """
    blocks = len(first)
    k = cross.shape[0] // blocks
    width = (k + LANES - 1) // LANES * LANES
    matrix = np.zeros((k, width), dtype=np.float32)
    found = np.empty((k, width), dtype=np.float32)
    inverse = np.empty((k, width), dtype=np.float32)
    order = np.empty(k, dtype=np.int64)
    score = 0.0
    for block in range(blocks):
        low = block * k
        for i in range(k):
            for j in range(k):
                matrix[i, j] = cross[low + i, low + j]
        trace = nearest_rotation(matrix, found, inverse, order, tolerance)
        for i in range(k):
            for j in range(k):
                rotation[low + i, low + j] = found[i, j]
        size = math.sqrt(max(0.0, first[block] * second[block]))
        if size > 0.0:
            score += min(1.0, trace / size) / blocks
    return score


def turn_reference(points: Floats, targets: Floats, blocks: int) -> tuple[float, Floats]:
    """The correlation and the map that `turn` finds for paired points, by SciPy's polar decomposition.

    Parameters
    ----------
    points, targets : float64, shape (p, blocks k)
    """
    rotation = np.zeros((points.shape[1], points.shape[1]))
    score = 0.0
    for columns in np.split(np.arange(points.shape[1]), blocks):
        x = points[:, columns] - points[:, columns].mean(axis=0)
        y = targets[:, columns] - targets[:, columns].mean(axis=0)
        factor, stretch = polar(x.T @ y)
        rotation[np.ix_(columns, columns)] = factor
        size = np.sqrt((x**2).sum() * (y**2).sum())
        score += np.trace(stretch) / size / blocks if size > 0.0 else 0.0
    return float(score), rotation
