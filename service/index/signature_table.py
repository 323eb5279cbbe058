"""The table of the signatures and coarse samples of all shapes, in memory, synchronised with the database."""

import threading
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.index import repository
from service.index.repository import NOTHING, IndexEntries
from service.observability.logging import get_logger
from service.storage.database import ReadSession

log = get_logger("search")


class SignatureTable:
    """The signatures and coarse samples of one pipeline's embeddings.

    Every process that changes searchable data increases the revision of the archive. A query compares the
    revision, then reads only later changes. The arrays that `current` returns never change afterwards, though
    later results share their memory: new shapes are appended behind their end.
    """

    def __init__(self, fingerprint: str) -> None:
        self._fingerprint = fingerprint
        self._lock = threading.Lock()
        self._revision = 0
        self._allocated = NOTHING
        self._length = 0

    def __len__(self) -> int:
        """Return the number of indexed shapes, as of the last query."""
        return self._length

    @property
    def revision(self) -> int:
        """The revision of the archive, as of the last query."""
        return self._revision

    @property
    def nbytes(self) -> int:
        """The bytes of the entries, as of the last query."""
        return self._used().nbytes

    def current(self, session: ReadSession) -> IndexEntries:
        """Return the entries that the session sees."""
        with self._lock:
            revision = repository.revision(session)
            if revision < self._revision:
                log.warning("the revision of the archive decreased: rebuilding the index of signatures")
                self._revision, self._allocated, self._length = 0, NOTHING, 0
            if revision > self._revision:
                expected = 0
                if self._revision:
                    self._drop(repository.removed_since(session, self._revision))
                else:  # an empty index has nothing to drop
                    expected = repository.count_shapes(session)
                for added in repository.entries_since(session, self._fingerprint, self._revision):
                    if self._revision:
                        self._drop(added.shapes)
                    self._append(added, expected)
                self._revision = revision
            return self._used()

    def _used(self) -> IndexEntries:
        return self._allocated.only(slice(self._length))

    def _drop(self, shapes: NDArray[np.int64]) -> None:
        """Remove shapes; the remaining entries are copied."""
        used = self._used()
        shapes = shapes[shapes <= used.shapes.max(initial=0)]
        if not len(shapes):
            return
        stays = ~np.isin(used.shapes, shapes)
        if not stays.all():
            self._allocated = used.only(stays)
            self._length = int(stays.sum())

    def _append(self, added: IndexEntries, expected: int) -> None:
        """Append shapes; if the allocated arrays are full, the entries are copied into larger ones.

        The new arrays have space for a quarter more than the entries, or than the `expected` number if it is
        larger. The operating system provides memory only for pages that are written.
        """
        start, end = self._length, self._length + len(added.shapes)
        added = _widened(added, self._allocated)
        if start == 0:
            self._allocated = added.only(slice(0))
        if end > start:
            self._allocated = _widened(self._allocated, added)
            if end > len(self._allocated.shapes):
                capacity = max(end + end // 4, expected + expected // 4)
                used, arrays = self._used(), self._allocated.arrays
                larger = [np.empty((capacity, *array.shape[1:]), array.dtype) for array in arrays]
                self._allocated = IndexEntries(*larger)
                for array, rows in zip(larger, used.arrays, strict=True):
                    array[:start] = rows
            for array, rows in zip(self._allocated.arrays, added.arrays, strict=True):
                array[start:end] = rows
        self._length = end


def _widened(entries: IndexEntries, others: IndexEntries) -> IndexEntries:
    """Return entries with rows of bytes at least as long as those of others, zeros at their ends."""
    wider: dict[str, Any] = {}
    for name in ("coarse_samples", "view_signatures"):
        rows: NDArray[np.uint8] = getattr(entries, name)
        lacking = getattr(others, name).shape[1] - rows.shape[1]
        if lacking > 0:
            wider[name] = np.pad(rows, ((0, 0), (0, lacking)))
    return replace(entries, **wider)
