"""Many eigenvalues of the Laplace-Beltrami operator.

This is ShapeDNA (Reuter, Wolter, Peinecke 2006), which tells individuals apart in any pose, as far as another
mesh of the surface has the same eigenvalues.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from core.spectral.spectral_embedding import FAINTEST, SPECTRUM

Halves = NDArray[np.float16]

WEYL = 4.0 * np.pi * np.arange(1, SPECTRUM + 1)
"""The eigenvalues times the area that every closed surface approaches (H. Weyl 1911)."""

FALL = 0.6
"""The weight of eigenvalue i falls with i to this power: the fine end has most of the noise of meshes."""

SCALE = 1.7
"""Factor by which near shapes have the distance of the signature's eigenvalues, too."""

TREND = WEYL / np.linalg.norm(WEYL)
"""The direction in which the logarithms of eigenvalues of another mesh differ."""

_WEIGHTS = SCALE * WEYL**-FALL / (WEYL**-FALL).sum()


def log_eigenvalues(values: Floats) -> Halves | None:
    """Return the logarithms of eigenvalues times the area over `WEYL`, shape (SPECTRUM,), in half precision.

    The ratio of the last of fewer values stands for those that lack; None if there is none.
    """
    if not len(values):
        return None
    known = np.maximum(values[:SPECTRUM], FAINTEST)
    logarithms = np.log(known / WEYL[: len(known)])
    return np.asarray(np.pad(logarithms, (0, SPECTRUM - len(known)), mode="edge"), dtype=np.float16)


def eigenvalue_distance(query: Halves, others: Sequence[Halves]) -> Floats:
    """Compute weighted mean absolute differences between one array and c others, shape (c,), >= 0."""
    differences = np.stack(others).astype(np.float64) - query
    return np.asarray(np.abs(eigenvalue_coordinates(differences)).sum(axis=1))


def eigenvalue_coordinates(logarithms: Floats) -> Floats:
    """Return points, shape (c, SPECTRUM), whose L1 distances are those of c arrays of log eigenvalues.

    The relative error of an eigenvalue of a mesh grows with the eigenvalue and with the area of a triangle
    (linear finite elements). The multiple of `WEYL` nearest to the logarithms is therefore removed, and so
    from their differences.
    """
    return np.asarray((logarithms - np.outer(logarithms @ TREND, TREND)) * _WEIGHTS)
