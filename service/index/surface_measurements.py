"""Measurements of all stored surfaces, in memory, synchronised with the database."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.descriptors.facts import GLOBAL_DESCRIPTORS, GLOBAL_WEIGHT
from core.registration.invariants import Invariants
from service.index import repository
from service.index.signature_table import SignatureTable
from service.storage.database import ReadSession


@dataclass(frozen=True, eq=False)
class MeasuredShapes:
    """Shapes with an embedding by one pipeline, by number ascending.

    Attributes
    ----------
    shapes, collections, embeddings : int64, shape (n,)
        Numbers of the shapes, of their collections and of their embeddings.
    signatures : float32, shape (n, s)
    invariants : Invariants
    """

    shapes: NDArray[np.int64]
    collections: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signatures: NDArray[np.float32]
    invariants: Invariants

    def index_of(self, shape: int) -> int | None:
        """Return the index of a shape; None if it is not there."""
        index = int(np.searchsorted(self.shapes, shape))
        return index if index < len(self.shapes) and self.shapes[index] == shape else None


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
        shapes = entries.shapes[order]
        facts = np.array([self._facts[number] for number in shapes.tolist()]).reshape(len(shapes), 5)
        signatures = entries.signatures[order]
        values = max(signatures.shape[1] - GLOBAL_DESCRIPTORS, 0)
        invariants = Invariants(
            eigenvalues=signatures[:, :values],
            descriptors=signatures[:, values:].astype(np.float64) / GLOBAL_WEIGHT,
            radii=facts[:, 0],
            extents=facts[:, 1:4],
            closed=facts[:, 4] > 0.0,
        )
        return MeasuredShapes(
            shapes, entries.collections[order], entries.embeddings[order], signatures, invariants
        )


def _numbers(facts: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the radius, the logarithms of the three extents, and 1 for a closed surface."""
    unit = float(facts["area"]) ** 0.5
    extents = np.log(np.maximum(np.array(facts["bounding_box"]) / unit, 1e-9)).tolist()
    return (facts["scale"] / unit, *extents, float(facts["boundary_edges"] == 0))
