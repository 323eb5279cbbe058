"""Distances of signatures: between log eigenvalues (the spectral distance) and global descriptors."""

import numpy as np

from core.arrays import Float32s, Floats
from core.descriptors.global_descriptors import GLOBAL_DESCRIPTORS, GLOBAL_WEIGHT


def spectral_distances(query: Float32s, signatures: Float32s) -> Floats:
    """Euclidean distances between the log eigenvalues of one signature and of c others, shape (c,), >= 0.

    Parameters
    ----------
    query : float32, shape (s,)
    signatures : float32, shape (c, s)
        Their last values are global descriptors, which do not count here.
    """
    values = len(query) - GLOBAL_DESCRIPTORS
    steps = signatures[:, :values].astype(np.float64) - query[:values]
    return np.asarray(np.linalg.norm(steps, axis=1))


def global_distances(query: Float32s, signatures: Float32s) -> Floats:
    """Euclidean distances between the global descriptors of one signature and of c others, shape (c,), >= 0.

    Parameters
    ----------
    query : float32, shape (s,)
        Global descriptors, times `GLOBAL_WEIGHT`, are its last values.
    signatures : float32, shape (c, s)
    """
    steps = signatures[:, -GLOBAL_DESCRIPTORS:].astype(np.float64) - query[-GLOBAL_DESCRIPTORS:]
    return np.asarray(np.linalg.norm(steps, axis=1) / GLOBAL_WEIGHT)
