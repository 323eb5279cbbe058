"""Signatures of eigenvalues, by which shapes are shortlisted."""

import numpy as np

from core.arrays import Floats

FAINTEST = 1e-2
"""An eigenvalue times the area below this is this: a tube a thousand times as long as wide has 0.03."""


def affinity_signature(values: Floats) -> Floats:
    """Logarithms of the leading eigenvalues' magnitudes over the root of their number, shape (s,).

    They must be over the number of samples, or of the operator on the surface: then a Gaussian affinity's sum
    to 1 or less, and they are comparable whatever the number.
    """
    return np.asarray(np.log(np.maximum(np.abs(values), 1e-6)) / np.sqrt(max(1, len(values))))


def laplacian_signature(values: Floats, area: float) -> Floats:
    """Logarithms of Laplace-Beltrami eigenvalues times the area, over the root of their number, shape (s,).

    ShapeDNA (Reuter, Wolter, Peinecke 2006) free of size by the area: the first eigenvalue, which its authors
    divide by, is the one that a thin neck or a loose part moves most. The distance between two is the root
    mean square difference of logarithms, whatever the number.
    """
    return np.asarray(np.log(np.maximum(values * area, FAINTEST)) / np.sqrt(max(1, len(values))))
