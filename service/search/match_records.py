"""A query scored against stored embeddings by their match records, points and coarse samples."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from core.arrays import Bytes, Float32s, Floats, Ints
from core.errors import CoreError
from core.matching.match_records import match_record, score_match_records
from core.parameters import Parameters
from core.ranking.reranking import coarse_ranking, quantised_points, rerank
from core.serialization import embedding_from_bytes
from service.index.cache import EmbeddingCache
from service.search import repository
from service.search.records import Query
from service.storage.database import Database


class QueryScorer:
    """Scores a query against stored embeddings.

    The match records and the points of the stored embeddings are cached; missing ones come from the database.
    Several threads may score at once.

    Attributes
    ----------
    match_record : float32, shape (l,)
        Of the query.

    Parameters
    ----------
    database : Database
    query : Query
        Of a pipeline whose matcher uses match records.
    """

    def __init__(self, database: Database, query: Query) -> None:
        self._database = database
        self._cache = query.active_pipeline.cache
        self._points = query.active_pipeline.points
        self._parameters = query.active_pipeline.pipeline.parameters
        cached = {} if query.number is None else self._cache.get([query.number])
        if query.number in cached:
            self.match_record = cached[query.number]
        else:
            self.match_record = match_record(query.embedding, self._parameters)

    def score(self, embeddings: Ints) -> Floats:
        """CC, SSD and sim of c embeddings by number: shape (3, c), NaN for the deleted ones."""
        numbers = embeddings.tolist()
        records = cached_match_records(self._database, self._cache, self._parameters, numbers)
        present = [place for place, number in enumerate(numbers) if number in records]
        found = score_match_records(
            self.match_record, [records[numbers[place]] for place in present], self._parameters
        )
        scores = np.full((3, len(numbers)), np.nan)
        scores[:, present] = found.cc, found.ssd, found.sim
        return scores

    def rerank(self, embeddings: Ints) -> Floats:
        """The approximate CC of c embeddings by number: shape (1, c), NaN for the deleted ones.

        Scores come from the points even if match records are cached: an answer never depends on the cache.
        """
        numbers = embeddings.tolist()
        points = cached_points(self._database, self._points, numbers)
        present = [place for place, number in enumerate(numbers) if number in points]
        found = rerank(self.match_record, [points[numbers[place]] for place in present], self._parameters)
        scores = np.full((1, len(numbers)), np.nan)
        scores[0, present] = found
        return scores

    def rank_coarsely(self, coarse_samples: Bytes) -> Floats:
        """The approximate CC of c embeddings by their coarse samples, (c, l): shape (1, c)."""
        return coarse_ranking(self.match_record, coarse_samples, self._parameters)[None].astype(np.float64)


def cached_match_records(
    database: Database, cache: EmbeddingCache[Float32s], parameters: Parameters, numbers: Sequence[int]
) -> dict[int, Float32s]:
    """The match records of embeddings by number; missing ones are made and cached.

    Deleted and unreadable embeddings are left out.
    """
    found = cache.get(numbers)
    missing = [number for number in numbers if number not in found]
    if missing:
        with database.read() as session:
            records = repository.embedding_records(session, missing)
        for number, record in records.items():
            try:
                found[number] = match_record(embedding_from_bytes(record), parameters)
            except CoreError:
                continue
            cache.put(number, found[number])
    return found


def cached_points(
    database: Database, cache: EmbeddingCache[bytes], numbers: Sequence[int]
) -> dict[int, bytes]:
    """The points of embeddings by number; missing ones are read and cached.

    Points that are not stored, or damaged, are made from the embedding. Deleted and unreadable embeddings are
    left out.
    """
    found = cache.get(numbers)
    missing = [number for number in numbers if number not in found]
    if not missing:
        return found
    with database.read() as session:
        read = repository.points(session, missing)
        without = [number for number in missing if number not in read]
        records = repository.embedding_records(session, without) if without else {}
    for number, record in records.items():
        with suppress(CoreError):
            read[number] = quantised_points(embedding_from_bytes(record))
    for number, points in read.items():
        cache.put(number, points)
    return found | read
