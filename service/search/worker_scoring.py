"""The scoring of a query by a worker of a cluster, which caches match records of its own."""

from collections.abc import Mapping
from functools import cache

import numpy as np
from threadpoolctl import threadpool_limits

from core.arrays import Float32s, Floats, Ints
from core.errors import CoreError
from core.matching.match_records import match_record, score_match_records
from core.parameters import Parameters
from core.serialization import embedding_from_bytes
from service.index.cache import EmbeddingCache


def score_on_worker(
    query: Float32s,
    numbers: Ints,
    records: Mapping[int, bytes],
    parameters: Parameters,
    user: int,
    room: int,
) -> tuple[Floats, Ints]:
    """Score a query against embeddings that this worker caches, or whose records come with the task.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record: see `core.matching.match_records`.
    numbers : int64, shape (c,)
        Of the embeddings.
    records : mapping of int to bytes
        By number, the embedding records that this worker lacked; their match records are cached from now on.
    parameters : Parameters
        Those that all were made with.
    user : int
        The service that the numbers belong to: it uses no number again while it runs.
    room : int
        The most bytes of match records that are cached, for all services; the least recently used go first.

    Returns
    -------
    float64, shape (3, c)
        CC, SSD and sim; NaN for embeddings that are missing here or unreadable.
    int64, shape (m,)
        The numbers of the embeddings that are missing here.
    """
    cache = _cache()
    cache.resize(room)
    keys = [(user << 64) + number for number in numbers.tolist()]
    found = cache.get(keys)
    for number, record in records.items():
        key = (user << 64) + number
        if key not in found:
            try:
                found[key] = match_record(embedding_from_bytes(record), parameters)
            except CoreError:
                continue
            cache.put(key, found[key])
    here = np.array([key in found for key in keys], dtype=bool)
    scored = score_match_records(query, [found[key] for key in keys if key in found], parameters)
    scores = np.full((3, len(keys)), np.nan)
    scores[:, here] = scored.cc, scored.ssd, scored.sim
    return scores, numbers[~here]


@cache
def _cache() -> EmbeddingCache[Float32s]:
    """The cache of this process, whose linear algebra runs on one thread from now on: see `match_record`."""
    threadpool_limits(1)
    return EmbeddingCache(0)
