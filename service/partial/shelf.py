"""The patches of stored shapes, in memory once they were made."""

import threading
from collections import OrderedDict

from core.embedding import Float32s

ROOM = 256 * 1024**2
"""Bytes; about 51 kB a shape."""


class PatchShelf:
    """Patches by the numbers of embeddings, which are never used again; the longest unused go first."""

    def __init__(self, room: int = ROOM) -> None:
        self._room = room
        self._lock = threading.Lock()
        self._kept: OrderedDict[int, Float32s] = OrderedDict()
        self._bytes = 0

    def get(self, number: int) -> Float32s | None:
        """Those of an embedding, if they are there."""
        with self._lock:
            if number in self._kept:
                self._kept.move_to_end(number)
            return self._kept.get(number)

    def put(self, number: int, patches: Float32s) -> None:
        """Keep those of an embedding, and drop others for which there is no more room."""
        with self._lock:
            if number not in self._kept:
                self._kept[number] = patches
                self._bytes += patches.nbytes
            while self._bytes > self._room and len(self._kept) > 1:
                _, dropped = self._kept.popitem(last=False)
                self._bytes -= dropped.nbytes
