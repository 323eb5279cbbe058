"""What is made of embeddings to compare them by, in memory."""

import threading
from collections import OrderedDict
from collections.abc import Iterable
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.arrays import Ints

Row = TypeVar("Row", bound=NDArray[Any])

ABOUT = 100_000
"""Bytes of a row, before one is known."""


class EmbeddingCache(Generic[Row]):
    """What is made of embeddings, by the embedding's number, which is never reused.

    That is the rows of `core.matching.match_records` of one pipeline's, or the patches of `core.descriptors.descriptor_distance` of any.

    A row that is taken off for want of room stays as long as someone reads it.

    Parameters
    ----------
    room : int
        How many bytes it may hold. Those not asked for longest go first.
    """

    def __init__(self, room: int) -> None:
        self._room = room
        self._lock = threading.Lock()
        self._rows: OrderedDict[int, Row] = OrderedDict()
        self._bytes = 0

    def __len__(self) -> int:
        """How many rows it holds."""
        return len(self._rows)

    @property
    def nbytes(self) -> int:
        """How many bytes."""
        return self._bytes

    def free_places(self) -> int:
        """About how many more rows it may hold, going by those that it does."""
        each = self._bytes // len(self._rows) if self._rows else ABOUT
        return (self._room - self._bytes) // each

    def rows(self, numbers: Iterable[int]) -> dict[int, Row]:
        """Those of the rows that are there."""
        found = {}
        with self._lock:
            for number in numbers:
                row = self._rows.get(number)
                if row is not None:
                    self._rows.move_to_end(number)
                    found[number] = row
        return found

    def missing(self, numbers: Iterable[int]) -> list[int]:
        """Those of the numbers whose rows are not there."""
        with self._lock:
            return [number for number in numbers if number not in self._rows]

    def put(self, number: int, row: Row) -> None:
        """Have a row there, if it is not longer than all the room."""
        with self._lock:
            known = self._rows.pop(number, None)
            self._bytes += row.nbytes - (0 if known is None else known.nbytes)
            self._rows[number] = row
            self._shrink()

    def keep(self, numbers: Ints) -> None:
        """Take off the rows of all embeddings but these, shape (n,): nobody asks for what is deleted."""
        with self._lock:
            held = np.fromiter(self._rows, dtype=np.int64, count=len(self._rows))
            for number in held[~np.isin(held, numbers)].tolist():
                self._bytes -= self._rows.pop(number).nbytes

    def resize(self, room: int) -> None:
        """Have another number of bytes as the most that it may hold."""
        with self._lock:
            self._room = max(room, 0)
            self._shrink()

    def _shrink(self) -> None:
        while self._bytes > self._room:
            _, dropped = self._rows.popitem(last=False)
            self._bytes -= dropped.nbytes
