"""What a worker of a cluster does of a search: it keeps rows of embeddings, and matches queries with them."""

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from core.arrays import Float32s
from core.errors import CoreError
from core.matching.match_records import match_rows, row_of
from core.parameters import Parameters
from core.serialization import embedding_from_bytes
from service.index.cache import EmbeddingCache

Scores = NDArray[np.float64]


def match_kept(
    query: Float32s,
    numbers: NDArray[np.int64],
    records: Mapping[int, bytes],
    parameters: Parameters,
    user: int,
    room: int,
) -> tuple[Scores, NDArray[np.int64]]:
    """Match a query with embeddings whose rows are kept here, or whose records come along.

    Parameters
    ----------
    query : float32, shape (l,)
        Of `core.matching.match_records.row_of`.
    numbers : int64, shape (c,)
        Of the embeddings.
    records : mapping of int to bytes
        By number, those that this worker told it had not; their rows are kept from now on.
    parameters : Parameters
        With pairs "both-ways", those that all were made with.
    user : int
        Whose numbers they are: no service uses a number again while it runs.
    room : int
        How many bytes of rows may be kept, for all services. Those not asked for longest go first.

    Returns
    -------
    float64, shape (3, c)
        CC, SSD and sim; NaN for those that are not here, or cannot be read.
    int64, shape (m,)
        The numbers of those that are not here.
    """
    cache = _cache()
    cache.resize(room)
    wanted = [(user << 64) + number for number in numbers.tolist()]
    rows = cache.rows(wanted)
    for number, record in records.items():
        key = (user << 64) + number
        if key not in rows:
            try:
                rows[key] = row_of(embedding_from_bytes(record), parameters)
            except CoreError:
                continue
            cache.put(key, rows[key])
    here = np.array([key in rows for key in wanted], dtype=bool)
    found = match_rows(query, [rows[key] for key in wanted if key in rows], parameters)
    scores = np.full((3, len(wanted)), np.nan)
    scores[:, here] = found.cc, found.ssd, found.sim
    return scores, numbers[~here]


@cache
def _cache() -> EmbeddingCache[Float32s]:
    """The one of this process, whose linear algebra runs on one thread from now on: see `row_of`."""
    threadpool_limits(1)
    return EmbeddingCache(0)
