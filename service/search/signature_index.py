"""The index of signatures, which finds candidates of a query: in memory, or in PostgreSQL with pgvector."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

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


@dataclass(frozen=True, eq=False)
class Wanted:
    """The shapes to look for: of `stored` in the collection those that match a filter, without the query.

    Of `shortlist_from` shapes or more, a shortlist is made: as many neighbours as wanted by signatures, and
    further ones by view signatures. None stands for no shortlist.
    """

    query: Query
    shapes: ShapeFilter
    stored: int
    shortlist_from: int | None
    by_signature: int
    by_views: int


@dataclass(frozen=True, eq=False)
class MemoryIndex:
    """The signatures in memory of all shapes that the active pipeline has embedded.

    `widening` is the factor by which more neighbours are looked for than remain after ranking by log odds.
    """

    table: SignatureTable
    widening: ClassVar[int] = 4

    def candidates(self, session: ReadSession, wanted: Wanted) -> tuple[IndexEntries, bool]:
        """Return the wanted shapes, and whether they are a shortlist; otherwise they lack their samples.

        The number of stored shapes without an embedding is logged.
        """
        query, shapes, stored = wanted.query, wanted.shapes, wanted.stored
        table = self.table.current(session)
        selected = table.collections == shapes.collection
        lacking = stored - np.count_nonzero(selected)
        if lacking > 0:
            log.info(
                "%d of %d stored shapes have no embedding by the active pipeline and are not searched",
                lacking,
                stored,
            )
        # Most shapes match a filter that only excludes some: reading these takes a hundredth of the time.
        others = replace(shapes, excluded=())
        if not others.is_empty:
            matching = shapes_repository.numbers(session, others)
            selected &= np.isin(table.shapes, np.array(matching, dtype=np.int64))
        excluded = [*query.excluded, *shapes_repository.numbers_of(session, shapes.excluded)]
        selected &= ~np.isin(table.shapes, np.array(excluded, dtype=np.int64))
        rows = np.flatnonzero(selected)
        if wanted.shortlist_from is None or len(rows) < wanted.shortlist_from:
            return table.without_samples().only(rows), False

        def nearest(
            distances: Callable[[NDArray[Any]], NDArray[Any]], vectors: NDArray[Any], count: int
        ) -> Ints:
            # If most shapes match the filter, gathering their signatures takes longer than measuring all.
            gathered = GATHERED_SHARE * len(rows) < len(vectors)
            measured = distances(vectors[rows]) if gathered else distances(vectors)[rows]
            return rows[least(measured, table.shapes[rows], count)]

        signatures = partial(signature_distances, query.embedding.signature)
        near = nearest(signatures, table.signatures, wanted.by_signature)
        views = partial(signature_distance, query.view_signature)
        further = nearest(views, table.view_signatures, wanted.by_views)
        return table.only(np.concatenate([near, further[~np.isin(further, near)]])), True

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


@dataclass(frozen=True)
class PostgresIndex:
    """The same signatures in PostgreSQL; the service then needs none in memory."""

    fingerprint: str
    widening: ClassVar[int] = 1
    revision: ClassVar[int] = 0
    nbytes: ClassVar[int] = 0

    def candidates(self, session: ReadSession, wanted: Wanted) -> tuple[IndexEntries, bool]:
        """Return the candidates as `MemoryIndex` does; both kinds of neighbours have their entries read once.

        The HNSW index finds neighbours if there is no filter and the collection has at least half of all
        shapes; otherwise exact search does, because most neighbours in the index would not match.
        """
        query, shapes = wanted.query, wanted.shapes
        excluded = np.array(sorted(query.excluded), dtype=np.int64)
        enough = partial(repository.has_at_least, session, self.fingerprint, shapes, excluded.tolist())
        if wanted.shortlist_from is None or not enough(wanted.shortlist_from):
            entries = repository.entries(session, self.fingerprint, shapes)
            return entries.only(~np.isin(entries.shapes, excluded)), False
        others = shapes.is_empty and shapes_repository.others_hold_shapes(session, shapes.collection)
        exact = not shapes.is_empty or (others and 2 * wanted.stored < count_shapes(session))
        signature = query.embedding.signature
        near, alike = (
            repository.nearest(
                session,
                self.fingerprint,
                vector,
                count + len(excluded),
                shapes=shapes,
                ef_search=None if exact else EF_SEARCH,
                views=views,
            )
            for vector, count, views in (
                (signature, wanted.by_signature + CLOSE, False),
                (query.view_signature, wanted.by_views, True),
            )
        )
        near = near[~np.isin(near, excluded)]
        alike = alike[~np.isin(alike, excluded)][: wanted.by_views]
        entries = repository.entries(session, self.fingerprint, np.union1d(near, alike))
        rows = np.flatnonzero(np.isin(entries.shapes, near))
        distances = signature_distances(signature, entries.signatures[rows])
        rows = rows[least(distances, entries.shapes[rows], wanted.by_signature)]
        further = np.isin(entries.shapes, alike)
        further[rows] = False
        return entries.only(np.concatenate([rows, np.flatnonzero(further)])), True

    def sampled_embeddings(self, session: ReadSession, collection: CollectionNumber) -> Ints:
        """Return the embeddings of the shapes of least hash, which the database computes."""
        return np.array(repository.sampled_embeddings(session, self.fingerprint, collection))

    def newest(self, session: ReadSession, count: int) -> Ints:
        """Return the `count` newest embeddings."""
        return np.array(repository.latest(session, self.fingerprint, count)[::-1])


def signature_index(container: Container, active_pipeline: ActivePipeline) -> MemoryIndex | PostgresIndex:
    """Return the index that the settings name: in memory, or in PostgreSQL."""
    if container.settings.signatures == "database":
        return PostgresIndex(active_pipeline.fingerprint)
    return MemoryIndex(active_pipeline.index)
