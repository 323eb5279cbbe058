"""The view signature and its distances against plain references."""

import numpy as np
from numpy.testing import assert_array_equal

from core.descriptors.panorama import ALONG, AROUND
from core.descriptors.view_frames import FRAMES
from core.descriptors.views import (
    ANGLE_BINS,
    DISTANCE_BINS,
    NORMAL_BINS,
    SIGNATURE_BYTES,
    VIEW_BYTES,
    magnitudes_of,
    shares_of,
    signature_distance,
    view_descriptor,
    view_signature,
)
from core.gallery import CLASSES, make_shape

RNG = np.random.default_rng(0)


def plain_signature(descriptor):
    """The lowest frequencies one by one, and each bin of pairs added to its coarser bin."""
    found, k = [], 0
    magnitudes, shares = magnitudes_of(descriptor), shares_of(descriptor)
    for row in range(2 * AROUND + 1):
        for half in range(ALONG + 1):
            norm = np.hypot((row + 1) // 2 / (AROUND + 0.5), half / (ALONG + 0.5))
            if norm < 0.35:
                found.append(1000.0 * sum(magnitudes[frame, :, :, k] for frame in range(FRAMES)) / FRAMES)
            k += norm <= 1.0
    coarse = np.zeros((4, NORMAL_BINS, 3))
    for i in range(DISTANCE_BINS):
        angles = [(larger, smaller) for larger in range(ANGLE_BINS) for smaller in range(larger + 1)]
        for j, (larger, smaller) in enumerate(angles):
            coarse[i // 3, :, (larger > 2) + (smaller > 2)] += shares[i, :, j]
    values = np.concatenate([np.stack(found, axis=-1).ravel(), 400.0 * np.sqrt(coarse).ravel()])
    return np.minimum(np.rint(values), 255)


def test_a_signature_is_that_of_a_plain_reference():
    made = [make_shape(label, 0) for label in CLASSES[:3]]
    described = [view_descriptor(mesh.vertices, mesh.faces) for mesh in made]
    for descriptor in [*described, RNG.integers(0, 80, VIEW_BYTES, dtype=np.uint8)]:
        signature = view_signature(descriptor)
        assert signature.dtype == np.uint8
        assert signature.shape == (SIGNATURE_BYTES,)
        assert np.abs(signature - plain_signature(descriptor)).max() <= 1
    assert SIGNATURE_BYTES <= 192


def test_distances_are_sums_of_absolute_differences():
    stored = RNG.integers(0, 256, size=(300, SIGNATURE_BYTES), dtype=np.uint8)
    stored[0], stored[1] = 0, 255
    for query in stored[:3]:
        expected = np.abs(stored.astype(int) - query).sum(axis=1)
        assert_array_equal(signature_distance(query, stored), expected)
    assert signature_distance(stored[0], stored[:0]).shape == (0,)
