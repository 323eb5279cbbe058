"""The table of the signatures and coarse samples of all shapes, in memory, synchronised with the database."""

import threading
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from service.index import repository
from service.index.repository import NOTHING, IndexEntries
from service.observability.logging import get_logger
from service.storage.database import ReadSession

log = get_logger("search")

_Scalar = TypeVar("_Scalar", bound=np.generic)


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
        return IndexEntries(*(array[: self._length] for array in _arrays(self._allocated)))

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
            self._allocated = IndexEntries(*(array[:0] for array in _arrays(added)))
        if end > start:
            self._allocated = _widened(self._allocated, added)
            if end > len(self._allocated.shapes):
                capacity = max(end + end // 4, expected + expected // 4)
                self._allocated = IndexEntries(
                    *(_enlarged(array, capacity) for array in _arrays(self._used()))
                )
            for array, more in zip(_arrays(self._allocated), _arrays(added), strict=True):
                array[start:end] = more
        self._length = end


def _arrays(entries: IndexEntries) -> list[NDArray[Any]]:
    """Return the arrays of the entries, in the order of the fields."""
    return [getattr(entries, field.name) for field in fields(entries)]


def _widened(entries: IndexEntries, others: IndexEntries) -> IndexEntries:
    """Entries with rows of bytes at least as long as those of others; rows of no bytes have length 0."""
    return replace(
        entries,
        coarse_samples=_padded(entries.coarse_samples, others.coarse_samples.shape[1]),
        view_signatures=_padded(entries.view_signatures, others.view_signatures.shape[1]),
    )


def _padded(rows: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Rows of at least `width` bytes, zeros at their ends."""
    if rows.shape[1] >= width:
        return rows
    padded = np.zeros((len(rows), width), dtype=np.uint8)
    padded[:, : rows.shape[1]] = rows
    return padded


def _enlarged(array: NDArray[_Scalar], length: int) -> NDArray[_Scalar]:
    """Return a copy of the array with space for `length` rows."""
    copy = np.empty((length, *array.shape[1:]), dtype=array.dtype)
    copy[: len(array)] = array
    return copy
