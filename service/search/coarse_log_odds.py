"""Approximate log odds that a query and many stored shapes are of one class, from the index alone."""

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Floats
from core.descriptors.partial import is_part
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import CoarseDescriptors, coarse_differences
from core.ranking.shortlist import least
from service.index.repository import IndexEntries
from service.search.records import Options, Query


def ranks_by_log_odds(options: Options) -> bool:
    """Whether approximate log odds choose the shortlist."""
    return options.rank_by == "combined"


def likeliest(query: Query, entries: IndexEntries, count: int) -> NDArray[np.intp]:
    """Indices of the entries of greatest approximate log odds, the greatest first: `count`, or all."""
    log_odds = coarse_log_odds(query, entries.signatures, entries.view_signatures, entries.reliabilities)
    return least(-log_odds, entries.shapes, count)


def coarse_log_odds(
    query: Query,
    signatures: Float32s,
    view_signatures: Bytes,
    reliabilities: Float32s,
    cc: Floats | None = None,
) -> Floats:
    """Log odds of c shapes, shape (c,).

    Parameters
    ----------
    query : Query
    signatures : float32, shape (c, s)
    view_signatures : uint8, shape (c, v)
    reliabilities : float32, shape (c,)
    cc : float64, shape (c,), optional
        Approximate CC; typical ones for the spectral distances unless given.
    """
    own = query.descriptors
    reliability = np.array([own.reliability], dtype=np.float32)
    return pooled_log_odds(
        coarse_differences(
            CoarseDescriptors(own.signature[None], query.view_signature[None], reliability),
            CoarseDescriptors(signatures, view_signatures, reliabilities),
            cc,
            part=is_part(query.spin_images),
        )
    )
