"""Approximate CC of one shape with many others, from their spectral coordinates in bytes.

The coarse ranking reads the first samples of each shape, a few hundred bytes: whole numbers in [-127, 127],
with one scale a column. The re-ranking reads all embedded points, without splines. Both choose the shapes
that are matched in full.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Int8s
from core.embedding import Embedding
from core.matching.kernels import one_to_many
from core.matching.match_records import compared, search_rounds
from core.parameters import Parameters

COARSE_SAMPLES = 32
"""Samples of each shape that a coarse ranking reads."""

LARGEST = 127
"""The largest quantised coordinate."""


def quantised(points: Float32s) -> tuple[Float32s, Int8s]:
    """Return a scale a column, shape (c,), and coordinates, shape (d, c), over the scales, rounded."""
    scales = (np.abs(points).max(axis=0) / np.float32(LARGEST)).astype(np.float32)
    coordinates = np.rint(np.divide(points, scales, out=np.zeros_like(points), where=scales > 0.0))
    return scales, coordinates.astype(np.int8)


def coarse_samples(embedding: Embedding) -> Bytes:
    """Return the first `COARSE_SAMPLES` samples in b spectral domains of k dimensions.

    The result, uint8 of shape (4 + 36 b k,), has the number of samples, int32; a scale for each column,
    float32; and the coordinates over it, int8. The scales are those of the samples alone, so the coordinates
    are finer than those of all points.
    """
    count = min(int(embedding.regions.max()) + 1, COARSE_SAMPLES)
    points = np.concatenate([spectrum.coordinates[:count] for spectrum in embedding.spectra], axis=1)
    coordinates = np.zeros((COARSE_SAMPLES, points.shape[1]), dtype=np.int8)
    scales, coordinates[:count] = quantised(points)
    return _joined(np.array([count], dtype=np.int32), scales, coordinates)


def coarse_ranking(query: Float32s, coarse_samples: Bytes, parameters: Parameters) -> Float32s:
    """Compute an approximate CC of one shape with each of c others, from their first samples.

    One search in each spectral domain, from the query alone, refined once. The query is a match record, and
    all were made with the parameters. The result, float32, shape (c,), is -1 for coarse samples without a
    sample.
    """
    rounds = search_rounds(parameters)._replace(
        sides=1, kept_maps=1, align_rounds=0, align_samples=COARSE_SAMPLES, final_rounds=0
    )
    ends = coarse_samples.shape[1] * np.arange(1, len(coarse_samples) + 1)
    scores, _ = compared(query, coarse_samples.ravel(), ends, one_to_many.COARSE_SAMPLES, rounds)
    return np.maximum(scores[:, 0], -1.0).astype(np.float32)


def rerank(query: Float32s, others: Sequence[bytes], parameters: Parameters) -> Float32s:
    """Compute an approximate CC of one shape with each of c others: one map, flat splines.

    Splines that do not bend take a hundredth of the time to make, and mostly lead to the same map. One map is
    kept, and not refined on all samples: of the ten shapes of greatest CC among 490, 99.6 % are among the
    first thirty. The query is a match record, the others are `core.matching.quantised_points`, and all were
    made with the parameters. The result, float32 of shape (c,), is in [-1, 1]; it is NaN if the bytes are not
    those of points, a coordinate is not finite, a region is not that of a sample, or the number of columns is
    not that of the parameters.
    """
    scores = np.full(len(others), np.nan, dtype=np.float32)
    readable = [i for i, points in enumerate(others) if points and len(points) % 4 == 0]
    if not readable:
        return scores
    data = np.frombuffer(bytearray().join(others[i] for i in readable), dtype=np.uint8)
    ends = np.cumsum([len(others[i]) for i in readable])
    rounds = search_rounds(parameters)._replace(kept_maps=1, final_rounds=0)
    cc = compared(query, data, ends, one_to_many.POINTS, rounds)[0][:, 0]
    scores[readable] = np.where(cc < -1.5, np.nan, cc)
    return scores


def _joined(*arrays: NDArray[np.generic]) -> Bytes:
    """Return the bytes of arrays, one after another."""
    return np.frombuffer(b"".join(array.tobytes() for array in arrays), dtype=np.uint8)
