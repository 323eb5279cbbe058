"""View signature: a short summary of a view descriptor, to search many shapes by.

The lowest frequencies of the panoramas, averaged over the frames, and the pair histogram with fewer bins.
"""

import numpy as np

from core.arrays import Bytes, Ints
from core.descriptors.pair_histogram import ANGLE_BINS, NORMAL_BINS
from core.descriptors.panorama import CHANNELS, frequency_radii, kept
from core.descriptors.view_bytes import magnitudes_of, shares_of
from core.numerics.compilation import compiled, constant

LOWEST = frequency_radii()[kept()] < 0.35
"""The frequencies of a panorama that the signature keeps, shape (FREQUENCIES,)."""

COARSE_DISTANCES = 4
"""Number of bins over the distance between two points."""

ALIGNED = 3
"""A normal is along the line between two points from this bin of `ANGLE_BINS` on: a cosine of 0.6."""

LARGER, SMALLER = np.tril_indices(ANGLE_BINS)
ALONG = np.eye(3)[(LARGER >= ALIGNED).astype(int) + (SMALLER >= ALIGNED)]
"""Weights, shape (ANGLE_PAIRS, 3), that add up the bins of two angles: neither normal is along the line
between two points, one is, or both are."""

SIGNATURE_BYTES = 3 * CHANNELS * int(LOWEST.sum()) + COARSE_DISTANCES * NORMAL_BINS * 3

LOW_SCALE, COARSE_SCALE = 1000.0, 400.0
"""A byte is the first factor times a magnitude, or the second times the root of a share, at most 255."""


def view_signature(descriptor: Bytes) -> Bytes:
    """The signature, shape (SIGNATURE_BYTES,), of a descriptor, shape (VIEW_BYTES,)."""
    low = magnitudes_of(descriptor).mean(axis=0)[..., LOWEST]
    shares = shares_of(descriptor).reshape(COARSE_DISTANCES, -1, NORMAL_BINS, len(ALONG)).sum(axis=1) @ ALONG
    values = np.concatenate([LOW_SCALE * low.ravel(), COARSE_SCALE * np.sqrt(shares).ravel()])
    return np.asarray(np.minimum(np.rint(values), 255.0).astype(np.uint8))


def signature_distance(query: Bytes, stored: Bytes) -> Ints:
    """L1 distances between one signature and c others, shape (c,).

    Parameters
    ----------
    query : uint8, shape (SIGNATURE_BYTES,)
    stored : uint8, shape (c, SIGNATURE_BYTES)
    """
    return _sums(constant(query), constant(stored))


@compiled
def _sums(query: Bytes, stored: Bytes) -> Ints:
    """L1 distances. A sum over at most 257 bytes fits 16 bits, in which it takes a third of the time."""
    sums = np.empty(len(stored), dtype=np.int64)
    for i in range(len(stored)):
        total = np.uint16(0)
        for k in range(len(query)):
            own, other = query[k], stored[i, k]
            total = np.uint16(total + np.uint16(own - other if own > other else other - own))
        sums[i] = total
    return sums
