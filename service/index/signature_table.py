"""Signatures, coarse samples and measurements of all shapes, in memory, synchronised with the database."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.descriptors.facts import GLOBAL_DESCRIPTORS, GLOBAL_WEIGHT
from core.registration.invariants import Invariants
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


@dataclass(frozen=True, eq=False)
class MeasuredShapes:
    """Shapes that one pipeline has embedded, by number ascending, without samples, and their invariants."""

    entries: IndexEntries
    invariants: Invariants

    def index_of(self, shape: int) -> int | None:
        """Return the index of a shape; None if it is not there."""
        shapes = self.entries.shapes
        index = int(np.searchsorted(shapes, shape))
        return index if index < len(shapes) and shapes[index] == shape else None


class SurfaceMeasurements:
    """Invariants of all shapes: about 300 bytes a shape. Only facts of new shapes are read again."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._revision = 0
        self._facts: dict[int, tuple[float, ...]] = {}
        self._known: tuple[SignatureTable, int, MeasuredShapes] | None = None

    def current(self, session: ReadSession, index: SignatureTable) -> MeasuredShapes:
        """Return the shapes that the session sees; `index` is that of the active pipeline."""
        with self._lock:
            # The index is read first: another query may bring it to a later revision while facts are read,
            # and an older revision rebuilds it.
            entries = index.current(session)
            revision = repository.revision(session)
            if self._known is not None and self._known[:2] == (index, revision):
                return self._known[2]
            if revision < self._revision:
                self._revision, self._facts = 0, {}
            for number, facts in repository.facts_since(session, self._revision):
                self._facts[number] = _numbers(facts)
            self._revision = revision
            measured = self._measured(entries)
            self._known = index, revision, measured
            return measured

    def _measured(self, entries: repository.IndexEntries) -> MeasuredShapes:
        stored = set(entries.shapes.tolist())
        if len(self._facts) > 2 * len(stored):
            self._facts = {number: facts for number, facts in self._facts.items() if number in stored}
        order = np.argsort(entries.shapes)
        order = order[[number in self._facts for number in entries.shapes[order].tolist()]]
        entries = entries.without_samples().only(order)
        facts = np.array([self._facts[number] for number in entries.shapes.tolist()])
        facts, signatures = facts.reshape(len(order), 9), entries.signatures
        values = max(signatures.shape[1] - GLOBAL_DESCRIPTORS, 0)
        invariants = Invariants(
            eigenvalues=signatures[:, :values],
            descriptors=signatures[:, values:].astype(np.float64) / GLOBAL_WEIGHT,
            radii=facts[:, 0],
            extents=facts[:, 1:4],
            gyration=facts[:, 4:7],
            faces=facts[:, 7].astype(np.int64),
            closed=facts[:, 8] > 0.0,
        )
        return MeasuredShapes(entries, invariants)


def _numbers(facts: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the fields of `Invariants` after the signature; the last is 1 for a closed surface."""
    unit = float(facts["area"]) ** 0.5
    sides, radii = (
        np.log(np.maximum(np.array(lengths) / whole, 1e-9)).tolist()
        for lengths, whole in (
            (facts["bounding_box"], unit),
            (facts["gyration_radii"], max(facts["volume"], 1e-9 * unit**3) ** (1.0 / 3.0)),
        )
    )
    closed = facts["boundary_edges"] == 0
    return (facts["scale"] / unit, *sides, *radii, float(facts["faces"]), float(closed))
