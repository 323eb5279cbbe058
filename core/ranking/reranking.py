"""Re-ranking: an approximate CC from the embedded points of each shape, without its splines."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Float32s
from core.matching.kernels.one_to_many import POINTS
from core.matching.match_records import compared, search_rounds
from core.parameters import Parameters


def rerank(query: Float32s, others: Sequence[bytes], parameters: Parameters) -> Float32s:
    """The approximate CC of one shape with each of c others: the match with flat splines for the others.

    Splines that do not bend take a hundredth of the time to make, and mostly lead to the same map.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.match_records`.
    others : sequence of bytes
        Their points: see `core.ranking.quantised_points`.
    parameters : Parameters
        Those that all were made with.

    Returns
    -------
    float32, shape (c,)
        In [-1, 1]; NaN if the bytes are not those of points, a coordinate is not finite, a region is not that
        of a sample, or the number of columns is not that of the parameters.
    """
    scores = np.full(len(others), np.nan, dtype=np.float32)
    whole = [i for i, points in enumerate(others) if points and len(points) % 4 == 0]
    if not whole:
        return scores
    data = np.frombuffer(bytearray().join(others[i] for i in whole), dtype=np.uint8)
    ends = np.cumsum([len(others[i]) for i in whole])
    cc = compared(query, data, ends, POINTS, search_rounds(parameters))[0][:, 0]
    scores[whole] = np.where(cc < -1.5, np.nan, cc)
    return scores
