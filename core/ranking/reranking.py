"""Re-ranking: an approximate CC from the embedded points of each shape, without its splines."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Float32s
from core.embedding import EmbeddedPoints
from core.matching.kernels.reranking import rerank_many
from core.matching.procrustes import search_rounds
from core.parameters import Parameters


def rerank(query: Float32s, clouds: Sequence[EmbeddedPoints], parameters: Parameters) -> Float32s:
    """The approximate CC of one shape with each of c others: the match with flat splines for the others.

    Splines that do not bend take a hundredth of the time to make, and mostly lead to the same map.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.match_records`.
    clouds : sequence of EmbeddedPoints
        Made with the same parameters.
    parameters : Parameters
        Those that all were made with.

    Returns
    -------
    float32, shape (c,)
        In [-1, 1]; NaN if a coordinate is not finite, a region is not that of a sample, or the number of
        coordinates is not that of the parameters.
    """
    scores = np.full(len(clouds), np.nan, dtype=np.float32)
    shape = (len(parameters.spectral.operators), parameters.spectral.dimensions)
    fit = [
        place
        for place, (coordinates, regions) in enumerate(clouds)
        if len(regions)
        and len(coordinates) == shape[0]
        and all(one.shape == (len(regions), shape[1]) and np.isfinite(one).all() for one in coordinates)
    ]
    if not fit:
        return scores
    found = np.empty(len(fit), dtype=np.float32)
    rerank_many(
        np.require(query, requirements=["C", "W"]),
        np.concatenate([np.hstack(clouds[place][0]) for place in fit]),
        np.concatenate([clouds[place][1] for place in fit]),
        np.cumsum([len(clouds[place][1]) for place in fit]),
        np.array(
            [
                parameters.matching.search_samples or parameters.sampling.samples,
                parameters.matching.first_dimensions,
            ]
        ),
        search_rounds(parameters),
        found,
    )
    scores[fit] = np.where(found < -1.5, np.nan, found)
    return scores
