"""The LRU cache of values that are made of embeddings, and the samples of collections.

The values are match records or descriptors. Local densities are measured in the samples.
"""

import math
import operator
import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Generic, TypeVar

import numpy as np
from cachetools import LRUCache

from core.arrays import Bytes, Float32s, Ints
from core.descriptors.registry import ShapeDescriptors
from core.ranking.kinds import NO_KIND, KindCoordinates
from core.ranking.local_density import (
    DensitySample,
    LocalDensities,
    all_log_eigenvalues,
    densities_in,
    estimated_densities,
)
from core.spectral.spectral_embedding import SPECTRUM

Value = TypeVar("Value")

ABOUT = 32_000
"""Bytes of a match record, before one is known."""


class EmbeddingCache(Generic[Value]):
    """Values by the number of their embedding, which is never reused; for several threads.

    A value that is evicted stays alive while a thread reads it.

    Parameters
    ----------
    room : int
        The most bytes of values. The least recently used ones are evicted.
    nbytes : callable, optional
        The bytes of a value; its attribute `nbytes` unless given.
    """

    def __init__(self, room: int, nbytes: Callable[[Value], int] = operator.attrgetter("nbytes")) -> None:
        self._lock = threading.Lock()
        self._room = max(room, 0)
        # The room changes, the bound of an LRUCache cannot: `_evict` bounds it instead.
        self._values: LRUCache[int, Value] = LRUCache(math.inf, getsizeof=nbytes)
        self._nbytes = nbytes

    def __len__(self) -> int:
        """Number of values."""
        return len(self._values)

    @property
    def nbytes(self) -> int:
        """Bytes of all values."""
        return int(self._values.currsize)

    def free_count(self) -> int:
        """Return the approximate number of further values that there is room for, of the mean size."""
        with self._lock:
            each = self.nbytes // len(self._values) if self._values else ABOUT
            return (self._room - self.nbytes) // each

    def get(self, numbers: Iterable[int]) -> dict[int, Value]:
        """Return the cached ones of the values, by number."""
        with self._lock:
            return {number: self._values[number] for number in numbers if number in self._values}

    def missing(self, numbers: Iterable[int]) -> list[int]:
        """Return the numbers whose values are not cached."""
        with self._lock:
            return [number for number in numbers if number not in self._values]

    def put(self, number: int, value: Value) -> None:
        """Cache a value, unless it is larger than the whole room."""
        with self._lock:
            self._values.pop(number, None)
            if self._nbytes(value) <= self._room:
                self._values[number] = value
                self._evict()

    def keep(self, numbers: Ints) -> None:
        """Evict all values but those of these embeddings, shape (n,): no query asks for a deleted one."""
        with self._lock:
            cached = np.fromiter(self._values, dtype=np.int64, count=len(self._values))
            for number in cached[~np.isin(cached, numbers)].tolist():
                del self._values[number]

    def resize(self, room: int) -> None:
        """Change the room."""
        with self._lock:
            self._room = max(room, 0)
            self._evict()

    def _evict(self) -> None:
        while self._values.currsize > self._room:
            self._values.popitem()


SAMPLE = 512
"""Number of shapes in a sample; smaller collections are sampled whole."""

COLLECTIONS, DENSITIES = 32, 20_000_000
"""Number of collections whose samples a pipeline keeps, of 9 to 18 MB each, and bytes of densities in one."""

ROW = 400
"""Bytes of the densities of a shape beside its coordinates in a kind."""

_NO_COORDINATES = np.zeros(SPECTRUM, dtype=np.float32)

PRIME, FIRST, SECOND = 2**31 - 1, 1_103_515_245, 654_435_761
"""Keys of the hash of shape numbers. Products of two numbers below the prime fit 64 bits, in SQL too."""


def sampled(shapes: Ints) -> Ints:
    """Return indices of the shapes of a sample, shape (min(n, SAMPLE),): those of least hash, ascending.

    `shapes` has the n numbers of the shapes of a collection. The hash depends on the number alone, so a set
    of shapes has the same sample in every process, and at most one sampled shape changes when a shape is
    stored or deleted.
    """
    if len(shapes) <= SAMPLE:
        return np.argsort(shapes)
    short = shapes % PRIME
    hashes = (short * short % PRIME * FIRST + short * SECOND) % PRIME
    last = np.partition(hashes, SAMPLE - 1)[SAMPLE - 1]
    least = np.flatnonzero(hashes <= last)
    order = np.lexsort((shapes[least], hashes[least]))[:SAMPLE]
    return np.asarray(np.sort(least[order]))


_Row = tuple[list[float], Float32s]
"""The three densities of a shape and the number of its kind, and its coordinates there."""


class CollectionSample:
    """The sample of a collection, with the densities that were measured in it.

    `embeddings` has the numbers of the embeddings of the sampled shapes, shape (m,). The density sample has
    the descriptors of those that can be read.
    """

    def __init__(self, embeddings: Ints, sample: DensitySample) -> None:
        self.embeddings = embeddings
        self._sample = sample
        # Each is a function of the embedding and the sample alone.
        self._densities: EmbeddingCache[_Row] = EmbeddingCache(
            DENSITIES, lambda row: ROW if row[1] is _NO_COORDINATES else ROW + row[1].nbytes
        )

    def of_query(self, query: ShapeDescriptors) -> LocalDensities:
        """Return the densities of one shape, arrays of shape (1,)."""
        return densities_in(self._sample, [query])

    def estimated(self, signatures: Float32s, view_signatures: Bytes) -> LocalDensities:
        """Return approximate densities of c shapes, shape (c,) each, from what the index has of them."""
        return estimated_densities(self._sample, signatures, view_signatures)

    def kinds_of(self, shapes: Sequence[ShapeDescriptors]) -> KindCoordinates:
        """Return the coordinates of c shapes in the metrics of their kinds."""
        return self._sample.kinds.of(all_log_eigenvalues(shapes))

    def of_stored(self, embeddings: Sequence[int], shapes: Sequence[ShapeDescriptors]) -> LocalDensities:
        """Return the densities of c stored shapes, shape (c,) each, by the numbers of their embeddings."""
        known = self._densities.get(embeddings)
        new = {number: shape for number, shape in zip(embeddings, shapes, strict=True) if number not in known}
        if new:
            measured = densities_in(self._sample, list(new.values()))
            columns = measured.spectral, measured.view, measured.network, measured.kinds.kinds
            for index, number in enumerate(new):
                has_kind = measured.kinds.kinds[index] != NO_KIND
                coordinates = measured.kinds.coordinates[index].copy() if has_kind else _NO_COORDINATES
                known[number] = [float(column[index]) for column in columns], coordinates
                self._densities.put(number, known[number])
        rows = [known[number] for number in embeddings]
        spectral, view, network, kinds = np.array([row[0] for row in rows]).reshape(-1, 4).T
        coordinates = np.array([row[1] for row in rows], dtype=np.float32).reshape(-1, SPECTRUM)
        return LocalDensities(spectral, view, network, KindCoordinates(kinds.astype(np.int64), coordinates))
