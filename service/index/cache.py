"""The LRU cache of arrays that are made of embeddings: match records, or spin images."""

import math
import threading
from collections.abc import Iterable
from typing import Any, Generic, TypeVar

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from core.arrays import Ints

Value = TypeVar("Value", bound=NDArray[Any])

ABOUT = 100_000
"""Bytes of an array, before one is known."""


class EmbeddingCache(Generic[Value]):
    """Arrays by the number of their embedding, which is never reused; for several threads.

    An array that is evicted stays alive while a thread reads it.

    Parameters
    ----------
    room : int
        The most bytes of arrays. The least recently used ones are evicted.
    """

    def __init__(self, room: int) -> None:
        self._lock = threading.Lock()
        self._room = max(room, 0)
        # The room changes, the bound of an LRUCache cannot: `_evict` bounds it instead.
        self._values: LRUCache[int, Value] = LRUCache(math.inf, getsizeof=lambda value: value.nbytes)

    def __len__(self) -> int:
        """Number of arrays."""
        return len(self._values)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return int(self._values.currsize)

    def free_places(self) -> int:
        """The approximate number of further arrays that there is room for, of the mean size."""
        with self._lock:
            each = self.nbytes // len(self._values) if self._values else ABOUT
            return (self._room - self.nbytes) // each

    def get(self, numbers: Iterable[int]) -> dict[int, Value]:
        """The cached ones of the arrays, by number."""
        with self._lock:
            return {number: self._values[number] for number in numbers if number in self._values}

    def missing(self, numbers: Iterable[int]) -> list[int]:
        """The numbers whose arrays are not cached."""
        with self._lock:
            return [number for number in numbers if number not in self._values]

    def put(self, number: int, value: Value) -> None:
        """Cache an array, unless it is larger than the whole room."""
        with self._lock:
            self._values.pop(number, None)
            if value.nbytes <= self._room:
                self._values[number] = value
                self._evict()

    def keep(self, numbers: Ints) -> None:
        """Evict all arrays but those of these embeddings, shape (n,): no query asks for a deleted one."""
        with self._lock:
            held = np.fromiter(self._values, dtype=np.int64, count=len(self._values))
            for number in held[~np.isin(held, numbers)].tolist():
                del self._values[number]

    def resize(self, room: int) -> None:
        """Change the room."""
        with self._lock:
            self._room = max(room, 0)
            self._evict()

    def _evict(self) -> None:
        while self._values.currsize > self._room:
            self._values.popitem()
