"""Lewis weights of the vertices for the fit z = f(x, y): Algorithm 1, Eqs. 4-12, with p = 2."""

from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from core.arrays import Floats
from core.errors import ParameterError

ROUNDING = 1e-12
"""A fit is exact if its squared residuals are below this fraction of the points' squares. The remainder is
rounding of a file in single precision, which must not select the samples of a flat shape."""


@dataclass(frozen=True, eq=False)
class LewisWeights:
    """Lewis weights of n points (Algorithm 1), each array of shape (n,).

    `leverage` has squared row norms of an orthonormal basis of B's columns, in [0, 1], summing to the rank
    (Eq. 2): for p = 2 the Lewis weights of B (Theorem 2). `residual` is rho = B x - z of the second stage,
    and `weights` q (Eq. 12), >= 0: in [0, 1] if normalised; the printed constants may give values above 1.
    """

    leverage: Floats
    residual: Floats
    weights: Floats


def polynomial_basis(x: Floats, y: Floats, degree: int) -> Floats:
    """Return B of Eq. 8, x^i y^j with i + j <= degree, shape (n, (degree + 1)(degree + 2) / 2).

    x and y are first scaled to [-1, 1], which changes the columns but not their span. Raise ParameterError if
    the degree is below 1 or above 12.
    """
    if not 1 <= degree <= 12:
        raise ParameterError(f"the degree must be 1 to 12, not {degree}")

    def scaled(values: Floats) -> Floats:
        middle = 0.5 * (values.max() + values.min())
        half = 0.5 * (values.max() - values.min())
        return np.asarray((values - middle) / (half if half > 0.0 else 1.0))

    def powers(values: Floats) -> list[Floats]:
        return list(accumulate([values] * degree, np.multiply, initial=np.ones_like(values)))

    powers_x, powers_y = powers(scaled(x)), powers(scaled(y))
    columns = [powers_x[i - j] * powers_y[j] for i in range(degree + 1) for j in range(i + 1)]
    return np.stack(columns).T


def orthonormal_basis(matrix: Floats) -> Floats:
    """Return an orthonormal basis of the columns' span, shape (n, rank), by a rank-revealing QR.

    For p = 2 this is the well-conditioned basis of Theorem 4.
    """
    basis, upper, _ = qr(matrix, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(upper))
    rank = int((diagonal > diagonal[0] * 1e-10).sum())
    return np.ascontiguousarray(basis[:, :rank])


def printed_constants(rank: int, epsilon: float) -> tuple[float, float]:
    """Return r1 of Eq. 11 and r2 of Eq. 12 as printed, for p = 2 and the exponent k = 2.

    Raise ParameterError if epsilon is outside (0, 1/7).
    """
    if not 0.0 < epsilon < 1.0 / 7.0:
        raise ParameterError(f"epsilon must be between 0 and 1/7, not {epsilon}")
    r1 = 16.0 * (2.0**2 + 2.0) * rank**2 * (rank * np.log(8.0 * 12.0) + np.log(200.0))
    r2 = 150.0 * 24.0**2 * rank**2 / epsilon**2 * (rank * np.log(280.0 / epsilon) + np.log(200.0))
    return float(r1), float(r2)


def lewis_weights(
    points: Floats,
    *,
    degree: int = 6,
    epsilon: float = 0.01,
    normalise: bool = True,
    random: NDArray[np.float64] | None = None,
) -> LewisWeights:
    """Compute Algorithm 1 for the points of a mesh in its normal frame.

    Stage one draws rows with probabilities from their leverage scores and fits z to these rows; stage two
    raises the weight of rows with a large residual (Eqs. 11 and 12). Raise ParameterError if the degree or
    epsilon is out of range.

    Parameters
    ----------
    points : float64, shape (n, 3)
        z is the direction of least variance.
    degree : int
        Degree of the polynomial surface f, 1 to 12 (the paper: 6).
    epsilon : float
        Error parameter in (0, 1/7); it affects r2 only.
    normalise : bool
        False keeps the printed r1 and r2. They are so large (about 1e7 and 2e14) that stage one keeps every
        row of any mesh below ten million vertices, and q follows the residual alone. True divides each of
        the two terms by its sum before taking the larger one, so that both count.
    random : float64, shape (n,), optional
        Uniform numbers in [0, 1) for the draw of stage one, used only if a probability is below 1. Without
        them stage one keeps every row.
    """
    basis = orthonormal_basis(polynomial_basis(points[:, 0], points[:, 1], degree))
    rank = basis.shape[1]
    r1, r2 = printed_constants(rank, epsilon)
    leverage = np.einsum("ij,ij->i", basis, basis)
    probability = np.minimum(1.0, leverage / rank * r1)
    z = points[:, 2]
    if (probability >= 1.0).all() or random is None:
        residual = basis @ (basis.T @ z) - z
    else:
        kept = random < probability
        root = 1.0 / np.sqrt(probability[kept])
        solution = np.linalg.lstsq(basis[kept] * root[:, None], z[kept] * root, rcond=None)[0]
        residual = basis @ solution - z
    squares = residual**2
    missed = float(squares.sum())
    exact = missed <= ROUNDING * float((points**2).sum())
    share = np.zeros_like(squares) if exact else squares / missed
    terms = (leverage / rank, share) if normalise else (probability, share * r2)
    return LewisWeights(leverage=leverage, residual=residual, weights=np.maximum(*terms))
