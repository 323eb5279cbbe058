"""The bytes of a view descriptor: magnitudes of the panoramas, frame by frame, then the pair histogram."""

import numpy as np

from core.arrays import Bytes, Floats
from core.descriptors.pair_histogram import ANGLE_PAIRS, DISTANCE_BINS, NORMAL_BINS
from core.descriptors.panorama import CHANNELS, kept
from core.descriptors.view_frames import FRAMES

FREQUENCIES = int(kept().sum())
"""Number of frequencies of a panorama."""

FRAME_PANORAMAS = 3 * CHANNELS
"""Number of panoramas of a frame."""

FRAME_BYTES = FRAME_PANORAMAS * FREQUENCIES
PANORAMA_BYTES = FRAMES * FRAME_BYTES
VIEW_BYTES = PANORAMA_BYTES + DISTANCE_BINS * NORMAL_BINS * ANGLE_PAIRS
"""Bytes of the panoramas of one frame, of those of all frames, and of a descriptor."""

MAGNITUDE_SCALE, SHARE_SCALE = 255.0, 510.0
"""A byte is this factor times the square root of a magnitude, or of a share of pairs, at most 255."""


def to_bytes(magnitudes: Floats, shares: Floats) -> Bytes:
    """The descriptor of one surface, shape (VIEW_BYTES,).

    Parameters
    ----------
    magnitudes : float64, shape (FRAMES, 3, CHANNELS, FREQUENCIES)
        From `core.descriptors.panorama.magnitudes`.
    shares : float64, shape (DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS)
        From `core.descriptors.pair_histogram`.
    """
    values = (MAGNITUDE_SCALE * np.sqrt(magnitudes), SHARE_SCALE * np.sqrt(shares))
    return np.concatenate([np.minimum(np.rint(some), 255.0).astype(np.uint8).ravel() for some in values])


def magnitudes_of(descriptor: Bytes) -> Floats:
    """Magnitudes of a descriptor, shape (FRAMES, 3, CHANNELS, FREQUENCIES), up to rounding."""
    values = (descriptor[:PANORAMA_BYTES] / MAGNITUDE_SCALE) ** 2
    return values.reshape(FRAMES, 3, CHANNELS, FREQUENCIES)


def shares_of(descriptor: Bytes) -> Floats:
    """Shares of pairs of a descriptor, shape (DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS), up to rounding.

    Shares above 0.25 are 0.25.
    """
    values = (descriptor[PANORAMA_BYTES:] / SHARE_SCALE) ** 2
    return values.reshape(DISTANCE_BINS, NORMAL_BINS, ANGLE_PAIRS)
