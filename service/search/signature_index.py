"""The index of signatures, which finds the nearest shapes: in memory, or in PostgreSQL with pgvector."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from core.arrays import Ints
from core.descriptors.views import signature_distance
from core.ranking.shortlist import least, signature_distances
from service.collection import CollectionNumber
from service.container import Container
from service.index.cache import sampled
from service.index.repository import IndexEntries, count_shapes
from service.index.signature_table import SignatureTable
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.records import Query
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession
from service.storage.postgresql import EF_SEARCH

log = get_logger("search")

GATHERED_SHARE = 3
"""If fewer than one shape in `GATHERED_SHARE` matches the filter, signatures are gathered before measuring
distances."""

CLOSE = 16
"""Additional neighbours, sorted again by distances in double precision: the database has single precision."""


class Selection(Protocol):
    """The shapes of a signature index that match a filter."""

    def has(self, count: int) -> bool:
        """Return whether there are at least `count` shapes."""

    def entries(self) -> IndexEntries:
        """Return all shapes, without their coarse samples."""

    def nearest(self, query: Query, by_signature: int, by_views: int) -> IndexEntries:
        """Return the nearest shapes by signatures, then further ones of the nearest by view signatures."""


class SignatureIndex(Protocol):
    """The signatures of all shapes that the active pipeline has embedded."""

    @property
    def widening(self) -> int:
        """The factor by which more neighbours are looked for than remain after the ranking by log odds."""

    def select(
        self, session: ReadSession, shapes: ShapeFilter, excluded: frozenset[int], stored: int
    ) -> Selection:
        """Return the shapes that match a filter, of `stored` in the collection, without some by number."""

    def sampled_embeddings(self, session: ReadSession, collection: CollectionNumber) -> Ints:
        """Return the embeddings of the sample of a collection, ascending by shape."""

    def newest(self, session: ReadSession, count: int) -> Ints:
        """Return the embeddings to cache, the newest last: all, or the last `count`."""

    @property
    def revision(self) -> int:
        """The revision of the archive that the signatures in memory are of; 0 if there are none."""

    @property
    def nbytes(self) -> int:
        """The bytes of the signatures in memory."""


def signature_index(container: Container, active_pipeline: ActivePipeline) -> SignatureIndex:
    """Return the index that the settings name: in memory, or in PostgreSQL."""
    if container.settings.signatures == "database":
        return PostgresIndex(active_pipeline.fingerprint)
    return MemoryIndex(active_pipeline.index)


@dataclass(frozen=True, eq=False)
class MemoryIndex:
    """The index of the signatures in memory."""

    table: SignatureTable
    widening: ClassVar[int] = 4

    def select(
        self, session: ReadSession, shapes: ShapeFilter, excluded: frozenset[int], stored: int
    ) -> "MemorySelection":
        """Return the shapes that match a filter, of `stored` in the collection, without some by number.

        The number of shapes of the collection without an embedding is logged.
        """
        entries = self.table.current(session)
        selected = entries.collections == shapes.collection
        lacking = stored - np.count_nonzero(selected)
        if lacking > 0:
            log.info(
                "%d of %d stored shapes have no embedding by the active pipeline and are not searched",
                lacking,
                stored,
            )
        if not shapes.is_empty:
            matching = shapes_repository.numbers(session, shapes)
            selected &= np.isin(entries.shapes, np.array(matching, dtype=np.int64))
        for number in excluded:
            selected &= entries.shapes != number
        return MemorySelection(entries, np.flatnonzero(selected))

    def sampled_embeddings(self, session: ReadSession, collection: CollectionNumber) -> Ints:
        """Return the embeddings of a collection's sample, the shapes of least hash, ascending by shape."""
        entries = self.table.current(session)
        rows = np.flatnonzero(entries.collections == collection)
        return entries.embeddings[rows[sampled(entries.shapes[rows])]]

    def newest(self, session: ReadSession, count: int) -> Ints:
        """Return the embeddings to cache, the newest last: all, or from a database the last `count`."""
        return self.table.current(session).embeddings

    @property
    def revision(self) -> int:
        """The revision of the archive that the signatures in memory are of; 0 if there are none."""
        return self.table.revision

    @property
    def nbytes(self) -> int:
        """The bytes of the signatures in memory."""
        return self.table.nbytes


@dataclass(frozen=True, eq=False)
class MemorySelection:
    """Rows of the table of signatures."""

    table: IndexEntries
    rows: NDArray[np.intp]

    def has(self, count: int) -> bool:
        """Return whether there are at least `count` shapes."""
        return len(self.rows) >= count

    def entries(self) -> IndexEntries:
        """Return all shapes, without their coarse samples."""
        without_samples = np.empty((len(self.table.shapes), 0), np.uint8)
        return replace(self.table, coarse_samples=without_samples).only(self.rows)

    def nearest(self, query: Query, by_signature: int, by_views: int) -> IndexEntries:
        """Return the nearest shapes by signatures, then further ones of the nearest by view signatures."""
        signatures = partial(signature_distances, query.embedding.signature)
        views = partial(signature_distance, query.view_signature)
        rows = self._nearest(signatures, self.table.signatures, by_signature)
        further = self._nearest(views, self.table.view_signatures, by_views)
        return self.table.only(np.concatenate([rows, further[~np.isin(further, rows)]]))

    def _nearest(
        self, distances: Callable[[NDArray[Any]], NDArray[Any]], table: NDArray[Any], count: int
    ) -> Ints:
        # If most shapes match the filter, gathering their signatures takes longer than measuring all.
        if GATHERED_SHARE * len(self.rows) < len(table):
            measured = distances(table[self.rows])
        else:
            measured = distances(table)[self.rows]
        return self.rows[least(measured, self.table.shapes[self.rows], count)]


@dataclass(frozen=True)
class PostgresIndex:
    """The index of the signatures in PostgreSQL; the service then needs none in memory."""

    fingerprint: str
    widening: ClassVar[int] = 1
    revision: ClassVar[int] = 0
    nbytes: ClassVar[int] = 0

    def select(
        self, session: ReadSession, shapes: ShapeFilter, excluded: frozenset[int], stored: int
    ) -> "PostgresSelection":
        """Select by SQL, which the methods of the selection run."""
        excluded_numbers = np.array(sorted(excluded), dtype=np.int64)
        return PostgresSelection(session, self.fingerprint, shapes, excluded_numbers, stored)

    def sampled_embeddings(self, session: ReadSession, collection: CollectionNumber) -> Ints:
        """Return the embeddings of the shapes of least hash, which the database computes."""
        return np.array(repository.sampled_embeddings(session, self.fingerprint, collection))

    def newest(self, session: ReadSession, count: int) -> Ints:
        """Return the `count` newest embeddings."""
        return np.array(repository.latest(session, self.fingerprint, count)[::-1])


@dataclass(frozen=True)
class PostgresSelection:
    """Shapes in the database.

    The HNSW index finds neighbours if there is no filter and the collection has at least half of all shapes;
    otherwise exact search does, because most neighbours in the index would not match.
    """

    session: ReadSession
    fingerprint: str
    shapes: ShapeFilter
    excluded: Ints
    stored: int

    def has(self, count: int) -> bool:
        """Count the shapes, up to `count`."""
        return repository.has_at_least(
            self.session, self.fingerprint, self.shapes, self.excluded.tolist(), count
        )

    def entries(self) -> IndexEntries:
        """Read the entries of all shapes."""
        entries = repository.entries(self.session, self.fingerprint, self.shapes)
        return entries.only(~np.isin(entries.shapes, self.excluded))

    def nearest(self, query: Query, by_signature: int, by_views: int) -> IndexEntries:
        """Ask the database for both kinds of neighbours, and read their entries once."""
        signature = query.embedding.signature
        near, alike = (
            repository.nearest(
                self.session,
                self.fingerprint,
                vector,
                count + len(self.excluded),
                shapes=self.shapes,
                ef_search=self._ef_search,
                views=views,
            )
            for vector, count, views in (
                (signature, by_signature + CLOSE, False),
                (query.view_signature, by_views, True),
            )
        )
        near = near[~np.isin(near, self.excluded)]
        alike = alike[~np.isin(alike, self.excluded)][:by_views]
        entries = repository.entries(self.session, self.fingerprint, np.union1d(near, alike))
        rows = np.flatnonzero(np.isin(entries.shapes, near))
        distances = signature_distances(signature, entries.signatures[rows])
        rows = rows[least(distances, entries.shapes[rows], by_signature)]
        further = np.isin(entries.shapes, alike)
        further[rows] = False
        return entries.only(np.concatenate([rows, np.flatnonzero(further)]))

    @cached_property
    def _ef_search(self) -> int | None:
        """The size of the candidate list of the HNSW search; None for exact search."""
        if not self.shapes.is_empty:
            return None
        others = shapes_repository.others_hold_shapes(self.session, self.shapes.collection)
        if others and 2 * self.stored < count_shapes(self.session):
            return None
        return EF_SEARCH
