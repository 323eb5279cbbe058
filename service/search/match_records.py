"""What a query and the stored embeddings are compared by."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s
from core.errors import CoreError
from core.matching.match_records import match_rows, row_of
from core.parameters import Parameters
from core.ranking.coarse_ranking import coarse_ranking
from core.ranking.reranking import rerank
from core.serialization import embedding_from_bytes, points_from_bytes
from service.index.cache import EmbeddingCache
from service.search import repository
from service.search.records import Query
from service.storage.database import Database

Scores = NDArray[np.float64]


class Rows:
    """A query's row, and those of the stored embeddings: from the shelf, and else of their records.

    Several threads may ask at once. `query` is the query's row.

    Parameters
    ----------
    database : Database
    query : Query
        Of a pipeline with pairs "both-ways".
    """

    def __init__(self, database: Database, query: Query) -> None:
        self._database = database
        self._cache = query.active_pipeline.cache
        self._parameters = query.active_pipeline.pipeline.parameters
        self.query = row_of(embedding_from_bytes(query.record), self._parameters)

    def matched(self, embeddings: NDArray[np.int64]) -> Scores:
        """CC, SSD and sim of c embeddings by number: shape (3, c), NaN for those that are gone."""
        numbers = embeddings.tolist()
        rows = cached_bytes(self._database, self._cache, self._parameters, numbers)
        present = [place for place, number in enumerate(numbers) if number in rows]
        found = match_rows(self.query, [rows[numbers[place]] for place in present], self._parameters)
        scores = np.full((3, len(numbers)), np.nan)
        scores[:, present] = found.cc, found.ssd, found.sim
        return scores

    def screened(self, embeddings: NDArray[np.int64]) -> Scores:
        """About the CC of c embeddings by number: shape (1, c), NaN for those that are gone.

        Of their records, whether they are on the shelf or not, so that what is there never decides an answer.
        """
        numbers = embeddings.tolist()
        with self._database.read() as session:
            records = repository.embedding_records(session, numbers)
        clouds = {}
        for number, record in records.items():
            with suppress(CoreError):
                clouds[number] = points_from_bytes(record)
        present = [place for place, number in enumerate(numbers) if number in clouds]
        found = rerank(self.query, [clouds[numbers[place]] for place in present], self._parameters)
        scores = np.full((1, len(numbers)), np.nan)
        scores[0, present] = found
        return scores

    def sifted(self, coarse_samples: Bytes) -> Scores:
        """Roughly the CC of c embeddings by their sketches, (c, l): shape (1, c)."""
        return coarse_ranking(self.query, coarse_samples, self._parameters)[None].astype(np.float64)


def cached_bytes(
    database: Database, cache: EmbeddingCache[Float32s], parameters: Parameters, numbers: Sequence[int]
) -> dict[int, Float32s]:
    """The rows of embeddings by number; those that are not on the shelf are made and put there.

    Without those that are gone, or cannot be read.
    """
    rows = cache.rows(numbers)
    missing = [number for number in numbers if number not in rows]
    if missing:
        with database.read() as session:
            records = repository.embedding_records(session, missing)
        for number, record in records.items():
            try:
                rows[number] = row_of(embedding_from_bytes(record), parameters)
            except CoreError:
                continue
            cache.put(number, rows[number])
    return rows
