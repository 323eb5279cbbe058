"""The thin-plate spline, Eqs. 14-16."""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from core.arrays import Floats
from core.errors import ParameterError


def tps_kernel(first: Floats, second: Floats) -> Floats:
    """phi(r) = r^2 log r^2 between points, shape (m, n).

    In two dimensions it gives the minimiser of Eq. 14's bending energy; in k >= 3 it is simply a
    conditionally positive definite kernel of order two.
    """
    squares = np.maximum(((first[:, None, :] - second[None, :, :]) ** 2).sum(axis=2), 0.0)
    return np.asarray(np.where(squares > 0.0, squares * np.log(np.maximum(squares, 1e-300)), 0.0))


def mean_pair_distance(points: Floats) -> float:
    """Mean distance between all pairs of different points: the paper's choice for beta."""
    distances = np.sqrt(((points[:, None, :] - points[None, :, :]) ** 2).sum(axis=2))
    count = len(points)
    return float(distances.sum()) / (count * (count - 1))


class ThinPlateSpline:
    """The spline on fixed source points: factored once, then fitted to any targets.

    Eq. 16 with the beta that it omits: [K + beta I, P; P^T, 0] [w; t] = [targets; 0], P = [1, source]. The
    null-space form is solved: w = Q2 (Q2^T (K + beta I) Q2)^-1 Q2^T targets, Q2 an orthonormal basis of the
    vectors that P^T takes to zero, so that the affine part is exact whatever beta is.

    Parameters
    ----------
    source : float64, shape (m, k), m >= k + 2
    beta : float
        Regularisation, >= 0 (Eq. 14): 0 interpolates, infinity leaves the affine least-squares fit.

    Raises
    ------
    ParameterError
        Beta is negative or there are too few points, or beta is 0 and points coincide.
    """

    def __init__(self, source: Floats, beta: float) -> None:
        count, dimensions = source.shape
        if not beta >= 0.0:
            raise ParameterError(f"beta must not be negative, but is {beta}")
        if count < dimensions + 2:
            raise ParameterError(f"a spline in {dimensions} dimensions needs {dimensions + 2} points")
        if beta == 0.0 and len(np.unique(source, axis=0)) < count:
            raise ParameterError("points coincide, so beta must be positive")
        self.source = source
        self.beta = beta
        affine = np.concatenate([np.ones((count, 1)), source], axis=1)
        basis, upper = np.linalg.qr(affine, mode="complete")
        self._affine = basis[:, : dimensions + 1]
        self._upper = upper[: dimensions + 1]
        self._bending = basis[:, dimensions + 1 :]
        self._kernel = tps_kernel(source, source)
        inner = self._bending.T @ self._kernel @ self._bending
        inner[np.diag_indices_from(inner)] += beta
        try:
            self._factor = cho_factor(0.5 * (inner + inner.T), check_finite=False)
        except LinAlgError as error:
            raise ParameterError("points nearly coincide, so beta must be larger") from error

    def fit(self, targets: Floats) -> tuple[Floats, Floats]:
        """Coefficients of Eq. 15 for targets of shape (m, d).

        Returns
        -------
        float64, shape (m, d)
            w, the warping coefficients.
        float64, shape (k + 1, d)
            t, the affine part; its first row is the translation.
        """
        w = self._bending @ cho_solve(self._factor, self._bending.T @ targets, check_finite=False)
        rest = self._affine.T @ (targets - self._kernel @ w)
        return w, np.asarray(np.linalg.lstsq(self._upper, rest, rcond=None)[0])

    def transform(self, points: Floats, w: Floats, t: Floats) -> Floats:
        """Values of g (Eq. 15) at points of shape (n, k): shape (n, d)."""
        return np.asarray(t[0] + points @ t[1:] + tps_kernel(points, self.source) @ w)

    def smoother(self) -> Floats:
        """S, shape (m, m), with g(source) = S targets: one small product is an iteration's whole warp.

        At the source points K w + P t = targets - beta w, so S = I - beta Q2 (Q2^T (K + beta I) Q2)^-1 Q2^T.
        """
        warping = self._bending @ cho_solve(self._factor, self._bending.T, check_finite=False)
        return np.asarray(np.eye(len(self.source)) - self.beta * warping)
