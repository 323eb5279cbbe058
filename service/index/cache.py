"""The LRU cache of arrays that are made of embeddings: match records, or spin images."""

import threading
from collections import OrderedDict
from collections.abc import Iterable
from typing import Any, Generic, TypeVar

import numpy as np
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
        self._room = room
        self._lock = threading.Lock()
        self._values: OrderedDict[int, Value] = OrderedDict()
        self._bytes = 0

    def __len__(self) -> int:
        """Number of arrays."""
        return len(self._values)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return self._bytes

    def free_places(self) -> int:
        """The approximate number of further arrays that there is room for, of the mean size."""
        each = self._bytes // len(self._values) if self._values else ABOUT
        return (self._room - self._bytes) // each

    def get(self, numbers: Iterable[int]) -> dict[int, Value]:
        """The cached ones of the arrays, by number."""
        found = {}
        with self._lock:
            for number in numbers:
                value = self._values.get(number)
                if value is not None:
                    self._values.move_to_end(number)
                    found[number] = value
        return found

    def missing(self, numbers: Iterable[int]) -> list[int]:
        """The numbers whose arrays are not cached."""
        with self._lock:
            return [number for number in numbers if number not in self._values]

    def put(self, number: int, value: Value) -> None:
        """Cache an array, unless it is larger than the whole room."""
        with self._lock:
            known = self._values.pop(number, None)
            self._bytes += value.nbytes - (0 if known is None else known.nbytes)
            self._values[number] = value
            self._shrink()

    def keep(self, numbers: Ints) -> None:
        """Evict all arrays but those of these embeddings, shape (n,): no query asks for a deleted one."""
        with self._lock:
            held = np.fromiter(self._values, dtype=np.int64, count=len(self._values))
            for number in held[~np.isin(held, numbers)].tolist():
                self._bytes -= self._values.pop(number).nbytes

    def resize(self, room: int) -> None:
        """Change the room."""
        with self._lock:
            self._room = max(room, 0)
            self._shrink()

    def _shrink(self) -> None:
        while self._bytes > self._room:
            _, dropped = self._values.popitem(last=False)
            self._bytes -= dropped.nbytes
