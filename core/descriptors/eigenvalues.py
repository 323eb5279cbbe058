"""Many eigenvalues of the Laplace-Beltrami operator.

This is ShapeDNA (Reuter, Wolter, Peinecke 2006). The fine end tells apart individuals
whose poses keep lengths.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from core.spectral.spectral_embedding import FAINTEST, SPECTRUM

Halves = NDArray[np.float16]


def log_eigenvalues(values: Floats) -> Halves | None:
    """Return the logarithms of eigenvalues times the area, shape (SPECTRUM,), in half precision.

    The last of fewer values stands for those that lack; None if there is none.
    """
    if not len(values):
        return None
    known = np.maximum(values[:SPECTRUM], FAINTEST)
    padded = np.pad(known, (0, SPECTRUM - len(known)), mode="edge")
    return np.asarray(np.log(padded), dtype=np.float16)


def eigenvalue_distance(query: Halves, others: Sequence[Halves]) -> Floats:
    """Compute mean absolute differences between one array of logarithms and c others, shape (c,), >= 0."""
    differences = np.stack(others).astype(np.float32) - query.astype(np.float32)
    return np.asarray(np.abs(differences).mean(axis=1), dtype=np.float64)
