"""The LRU cache of values that are made of embeddings: match records, points, or descriptors."""

import math
import operator
import threading
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

import numpy as np
from cachetools import LRUCache

from core.arrays import Ints

Value = TypeVar("Value")

ABOUT = 100_000
"""Bytes of a match record, before one is known."""

POINTS_BYTES = 12_100
"""Bytes of the points of a shape, likewise."""


class EmbeddingCache(Generic[Value]):
    """Values by the number of their embedding, which is never reused; for several threads.

    A value that is evicted stays alive while a thread reads it.

    Parameters
    ----------
    room : int
        The most bytes of values. The least recently used ones are evicted.
    nbytes : callable, optional
        The bytes of a value; its attribute `nbytes` unless given.
    about : int, optional
        The bytes that a value is taken for before one is known; `ABOUT` unless given.
    """

    def __init__(
        self, room: int, nbytes: Callable[[Value], int] = operator.attrgetter("nbytes"), about: int = ABOUT
    ) -> None:
        self._lock = threading.Lock()
        self._room = max(room, 0)
        # The room changes, the bound of an LRUCache cannot: `_evict` bounds it instead.
        self._values: LRUCache[int, Value] = LRUCache(math.inf, getsizeof=nbytes)
        self._nbytes, self._about = nbytes, about

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
            each = self.nbytes // len(self._values) if self._values else self._about
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
