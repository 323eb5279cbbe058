"""Approximate CC of one shape with many others, from their first samples in bytes: a kilobyte a shape.

Coordinates are whole numbers in [-127, 127], with one scale a column. The re-ranking of a shortlist chooses
the shapes that are matched in full.
"""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Int8s
from core.embedding import Embedding
from core.matching.kernels.one_to_many import COARSE_SAMPLES
from core.matching.match_records import compared, search_rounds
from core.parameters import Parameters

KEPT_SAMPLES = 48
"""Samples of each shape that a re-ranking reads.

Of the three shapes of greatest CC among 1,025 (psb, shrec11, tosca, webmodels), 98.9 % are among the first 43
of a re-ranking, and of the ten, 97.2 % among the first 50 (205 queries).
"""

LARGEST = 127
"""The largest quantised coordinate."""


def quantised(points: Float32s) -> tuple[Float32s, Int8s]:
    """Return a scale a column, shape (c,), and coordinates, shape (d, c), over the scales, rounded."""
    scales = (np.abs(points).max(axis=0) / np.float32(LARGEST)).astype(np.float32)
    coordinates = np.rint(np.divide(points, scales, out=np.zeros_like(points), where=scales > 0.0))
    return scales, coordinates.astype(np.int8)


def coarse_samples(embedding: Embedding) -> Bytes:
    """Return the first `KEPT_SAMPLES` samples in b spectral domains of k dimensions.

    The result, uint8 of shape (4 + 52 b k,), has the number of samples, int32; a scale for each column,
    float32; and the coordinates over it, int8. The scales are those of the samples alone, so the coordinates
    are finer than those of all points.
    """
    count = min(int(embedding.regions.max()) + 1, KEPT_SAMPLES)
    points = np.concatenate([spectrum.coordinates[:count] for spectrum in embedding.spectra], axis=1)
    coordinates = np.zeros((KEPT_SAMPLES, points.shape[1]), dtype=np.int8)
    scales, coordinates[:count] = quantised(points)
    return _joined(np.array([count], dtype=np.int32), scales, coordinates)


def rerank(query: Float32s, coarse_samples: Bytes, parameters: Parameters) -> Float32s:
    """Compute an approximate CC of one shape with each of c others, from their first samples.

    Searches from both shapes, of which the best is refined. The splines of the others do not bend: these take
    a hundredth of the time to make, and mostly lead to the same map. The query is a match record, and all
    were made with the parameters. The result, float32, shape (c,), is -1 for coarse samples without a sample.
    """
    rounds = search_rounds(parameters)._replace(kept_maps=1, align_samples=KEPT_SAMPLES, final_rounds=0)
    ends = coarse_samples.shape[1] * np.arange(1, len(coarse_samples) + 1)
    scores, _ = compared(query, coarse_samples.ravel(), ends, COARSE_SAMPLES, rounds)
    return np.maximum(scores[:, 0], -1.0).astype(np.float32)


def _joined(*arrays: NDArray[np.generic]) -> Bytes:
    """Return the bytes of arrays, one after another."""
    return np.frombuffer(b"".join(array.tobytes() for array in arrays), dtype=np.uint8)
