"""Coarse ranking: an approximate CC from the first samples of each shape, in a few hundred bytes."""

import numpy as np

from core.arrays import Bytes, Float32s
from core.embedding import Embedding
from core.matching.kernels import one_to_many
from core.matching.match_records import compared, search_rounds
from core.parameters import Parameters
from core.ranking.quantised_points import joined, quantised

COARSE_SAMPLES = 32
"""Samples of each shape that a coarse ranking reads."""


def coarse_samples(embedding: Embedding) -> Bytes:
    """The first `COARSE_SAMPLES` samples, in b spectral domains of k dimensions, uint8, shape (4 + 36 b k,).

    The number of samples, int32; a scale for each column, float32; the coordinates over it, int8. All bytes
    are zero if there are no samples.
    """
    samples = int(embedding.regions.max()) + 1
    count = min(samples, COARSE_SAMPLES)
    points = np.concatenate([one.coordinates[:count] for one in embedding.spectra], axis=1)
    whole = np.zeros((COARSE_SAMPLES, points.shape[1]), dtype=np.int8)
    scales, whole[:count] = quantised(points)
    return joined(np.array([count], dtype=np.int32), scales, whole)


def coarse_ranking(query: Float32s, coarse_samples: Bytes, parameters: Parameters) -> Float32s:
    """The approximate CC of one shape with each of c others, to choose the ones that are matched.

    One search in each spectral domain, from the query alone, refined once.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.match_records`.
    coarse_samples : uint8, shape (c, 4 + 36 b k)
    parameters : Parameters
        Those that all were made with.

    Returns
    -------
    float32, shape (c,)
        -1 for coarse samples without a sample.
    """
    rounds = search_rounds(parameters)._replace(
        sides=1, kept_maps=1, align_rounds=0, align_samples=COARSE_SAMPLES, final_rounds=0
    )
    ends = coarse_samples.shape[1] * np.arange(1, len(coarse_samples) + 1)
    scores, _ = compared(query, coarse_samples.ravel(), ends, one_to_many.COARSE_SAMPLES, rounds)
    return np.maximum(scores[:, 0], -1.0).astype(np.float32)
