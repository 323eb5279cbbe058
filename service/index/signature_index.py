"""The signatures and sketches of all shapes, in memory, kept up with the database."""

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


class SignatureIndex:
    """The signatures and sketches of one pipeline.

    Whatever process wrote, it counted the archive's revision up; a query reads that first, and then only what
    changed since. What `current` returns is never changed afterwards, though it shares memory with what comes
    later: new shapes are written behind its end.
    """

    def __init__(self, fingerprint: str) -> None:
        self._fingerprint = fingerprint
        self._lock = threading.Lock()
        self._revision = 0
        self._room = NOTHING
        self._length = 0

    def __len__(self) -> int:
        """How many shapes it holds, as of the last query."""
        return self._length

    @property
    def revision(self) -> int:
        """Of the archive, as of the last query."""
        return self._revision

    def current(self, session: ReadSession) -> IndexEntries:
        """The shapes and signatures as the session sees them."""
        with self._lock:
            revision = repository.revision(session)
            if revision < self._revision:
                log.warning("the database went back in time; reading it anew")
                self._revision, self._room, self._length = 0, NOTHING, 0
            if revision > self._revision:
                expected = 0
                if self._revision:
                    self._drop(repository.removed_since(session, self._revision))
                else:  # an index that holds nothing has nothing to drop
                    expected = repository.shapes_stored(session)
                for added in repository.entries_since(session, self._fingerprint, self._revision):
                    if self._revision:
                        self._drop(added.shapes)
                    self._append(added, expected)
                self._revision = revision
            return self._used()

    def _used(self) -> IndexEntries:
        return IndexEntries(*(part[: self._length] for part in _container(self._room)))

    def _drop(self, shapes: NDArray[np.int64]) -> None:
        """Leave out these shapes, in new memory."""
        used = self._used()
        shapes = shapes[shapes <= used.shapes.max(initial=0)]
        if not len(shapes):
            return
        stays = ~np.isin(used.shapes, shapes)
        if not stays.all():
            self._room = used.only(stays)
            self._length = int(stays.sum())

    def _append(self, added: IndexEntries, expected: int) -> None:
        """Add shapes; in new memory where there is no room behind the end.

        That has room for a quarter more, and for as many as are expected in all: memory is held where it is
        written to.
        """
        start, end = self._length, self._length + len(added.shapes)
        width = max(self._room.coarse_samples.shape[1], added.coarse_samples.shape[1])
        added = replace(added, coarse_samples=_wide(added.coarse_samples, width))
        if start == 0:
            self._room = IndexEntries(*(part[:0] for part in _container(added)))
        if end > start:
            self._room = replace(self._room, coarse_samples=_wide(self._room.coarse_samples, width))
            if end > len(self._room.shapes):
                room = max(end + end // 4, expected + expected // 4)
                self._room = IndexEntries(*(_grown(part, room) for part in _container(self._used())))
            for part, more in zip(_container(self._room), _container(added), strict=True):
                part[start:end] = more
        self._length = end


def _container(entries: IndexEntries) -> list[NDArray[Any]]:
    """The arrays, in their order."""
    return [getattr(entries, field.name) for field in fields(entries)]


def _wide(coarse_samples: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """The sketches in rows of `width`: where none of several shapes has one, they come without a length."""
    if coarse_samples.shape[1] == width:
        return coarse_samples
    wide = np.zeros((len(coarse_samples), width), dtype=np.uint8)
    wide[:, : coarse_samples.shape[1]] = coarse_samples
    return wide


def _grown(array: NDArray[_Scalar], length: int) -> NDArray[_Scalar]:
    """The array in room for `length` rows."""
    room = np.empty((length, *array.shape[1:]), dtype=array.dtype)
    room[: len(array)] = array
    return room
