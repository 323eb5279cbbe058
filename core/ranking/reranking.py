"""Re-ranking: an approximate CC from the quantised samples of each shape, without its splines."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Float32s
from core.matching.kernels.reranking import rerank_many
from core.matching.procrustes import search_rounds
from core.parameters import Parameters


def rerank(query: Float32s, others: Sequence[bytes], parameters: Parameters) -> Float32s:
    """The approximate CC of one shape with each of c others: the match with flat splines for the others.

    Splines that do not bend take a hundredth of the time to make, and mostly lead to the same map. Partners
    are samples: they do not slide to the nearest of all points, which hardly changes the order.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.match_records`.
    others : sequence of bytes
        Their samples: see `core.ranking.quantised_samples`.
    parameters : Parameters
        Those that all were made with.

    Returns
    -------
    float32, shape (c,)
        In [-1, 1]; NaN if the bytes are not those of samples in as many columns as the parameters ask for,
        or a coordinate is not finite.
    """
    scores = np.full(len(others), np.nan, dtype=np.float32)
    whole = [place for place, samples in enumerate(others) if samples and len(samples) % 4 == 0]
    if not whole:
        return scores
    found = np.empty(len(whole), dtype=np.float32)
    search = parameters.matching.search_samples or parameters.sampling.samples
    rerank_many(
        np.require(query, requirements=["C", "W"]),
        np.frombuffer(bytearray().join(others[place] for place in whole), dtype=np.uint8),
        np.cumsum([len(others[place]) for place in whole]),
        np.array([search, parameters.matching.first_dimensions]),
        search_rounds(parameters)._replace(slides=0),
        found,
    )
    scores[whole] = np.where(found < -1.5, np.nan, found)
    return scores
