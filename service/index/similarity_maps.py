"""The last maps of shapes, by the embeddings of their shapes."""

import threading

from cachetools import LRUCache

from core.arrays import Ints
from core.ranking.similarity_map import SimilarityMap

MAPS = 16
"""Number of maps that are kept, of at most 64 kB each."""


class SimilarityMaps:
    """An LRU cache of maps, for several threads. Numbers of embeddings are never reused."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._maps: LRUCache[bytes, SimilarityMap] = LRUCache(MAPS)

    def get(self, embeddings: Ints) -> SimilarityMap | None:
        """The map of shapes with these embeddings, shape (n,), if it is kept."""
        with self._lock:
            return self._maps.get(embeddings.tobytes())

    def put(self, embeddings: Ints, found: SimilarityMap) -> None:
        """Keep a map."""
        with self._lock:
            self._maps[embeddings.tobytes()] = found
