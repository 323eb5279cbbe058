"""Lewis weights of the vertices for the fit z = f(x, y): Algorithm 1, Eqs. 4-12, with p = 2."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from core.arrays import Floats
from core.errors import ParameterError

ROUNDING = 1e-12
"""A fit whose squared residuals are below this part of the points' squares is exact: what is left is the
rounding of a file in single precision, and would choose the samples of a flat shape."""


@dataclass(frozen=True, eq=False)
class LewisWeights:
    """What Algorithm 1 finds for n points.

    Attributes
    ----------
    leverage : float64, shape (n,)
        Squared row norms of an orthonormal basis of B's columns, in [0, 1], summing to the rank (Eq. 2).
    residual : float64, shape (n,)
        The second stage's rho, B x - z (Eq. 12).
    weights : float64, shape (n,)
        q of Eq. 12. As printed they may pass 1; normalised they are in [0, 1].
    """

    leverage: Floats
    residual: Floats
    weights: Floats


def polynomial_basis(x: Floats, y: Floats, degree: int) -> Floats:
    """B of Eq. 8: the monomials x^i y^j with i + j <= degree, shape (n, (degree + 1)(degree + 2) / 2).

    x and y are first scaled to [-1, 1], which changes the columns but not their span.

    Raises
    ------
    ParameterError
        Degree under 1 or over 12.
    """
    if not 1 <= degree <= 12:
        raise ParameterError(f"the degree must be 1 to 12, not {degree}")

    def scaled(values: Floats) -> Floats:
        middle = 0.5 * (values.max() + values.min())
        half = 0.5 * (values.max() - values.min())
        return np.asarray((values - middle) / (half if half > 0.0 else 1.0))

    powers_x = scaled(x)[:, None] ** np.arange(degree + 1)
    powers_y = scaled(y)[:, None] ** np.arange(degree + 1)
    columns = [powers_x[:, i - j] * powers_y[:, j] for i in range(degree + 1) for j in range(i + 1)]
    return np.asarray(np.stack(columns, axis=1))


def orthonormal_basis(matrix: Floats) -> Floats:
    """An orthonormal basis of the columns' span, shape (n, rank), by a rank-revealing QR.

    For p = 2 it is the well-conditioned basis of Theorem 4.
    """
    basis, upper, _ = qr(matrix, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(upper))
    rank = int((diagonal > diagonal[0] * 1e-10).sum())
    return np.ascontiguousarray(basis[:, :rank])


def leverage_scores(matrix: Floats) -> Floats:
    """a_i^T (A^T A)^-1 a_i of each row (Eq. 2), shape (n,); for p = 2 the Lewis weights (Theorem 2)."""
    basis = orthonormal_basis(matrix)
    return np.asarray(np.einsum("ij,ij->i", basis, basis))


def printed_constants(rank: int, epsilon: float) -> tuple[float, float]:
    """r1 of Eq. 11 and r2 of Eq. 12 as printed, p = 2 and the exponent k = 2.

    Raises
    ------
    ParameterError
        Epsilon outside (0, 1/7).
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
    """Algorithm 1 for the points of a mesh in its normal frame.

    Stage one weighs each row by its leverage score and fits z to the rows that a draw with those
    probabilities keeps; stage two adds the rows that the fit misses (Eqs. 11, 12).

    Parameters
    ----------
    points : float64, shape (n, 3)
        z is the direction of least spread.
    degree : int
        Of the polynomial surface f (the paper: 6).
    epsilon : float
        Error parameter in (0, 1/7); it enters r2 alone.
    normalise : bool
        False keeps the printed r1 and r2. They are so large (about 1e7 and 2e14) that stage one keeps every
        row of any mesh under ten million vertices, and q follows the residual alone. True divides each of
        the two terms by its sum before the larger one is taken, so that both count.
    random : float64, shape (n,), optional
        Uniform numbers in [0, 1) for stage one's draw, wanted only where a probability is under 1.

    Raises
    ------
    ParameterError
        Degree or epsilon out of range.
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
