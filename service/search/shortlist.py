"""The candidates of a query: all shapes that match its filter, or a shortlist of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Ints
from core.descriptors.views import signature_distance
from core.ranking.local_density import LocalDensities
from core.ranking.shortlist import least, signature_distances
from service.container import Container
from service.index.density_samples import CollectionSample
from service.index.repository import IndexEntries
from service.observability.logging import get_logger
from service.search.coarse_log_odds import likeliest, ranks_by_log_odds
from service.search.database_shortlist import entries_in_database
from service.search.descriptors import collection_sample
from service.search.records import Options, Query
from service.search.shortlist_length import views_of
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession
from service.storage.hnsw_parameters import HnswParameters

log = get_logger("search")

FEW = 3
"""If fewer than one shape in `FEW` matches the filter, signatures are gathered before measuring distances."""

WIDE = 4
"""Factor by which more neighbours are found than remain after the ranking by approximate log odds."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The shapes that a query is compared with.

    Attributes
    ----------
    shapes, embeddings : int64, shape (c,)
        Numbers of the shapes and of their embeddings.
    signature : float32, shape (s,)
        The signature of the query.
    signatures : float32, shape (c, s)
    coarse_samples : uint8, shape (c, l)
    view_signatures : uint8, shape (c, v)
    reliabilities : float32, shape (c,)
    reranked, finalists : int or None
        How many of them coarse ranking passes on to re-ranking, and how many of those are compared in full;
        None passes on all.
    stored : int
        Number of shapes in the collection.
    sample : CollectionSample or None
        In which local densities are measured; typical densities are used without one.
    density : LocalDensities or None
        Of the query, in the sample.
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signature: NDArray[np.float32]
    signatures: NDArray[np.float32]
    coarse_samples: NDArray[np.uint8]
    view_signatures: NDArray[np.uint8]
    reliabilities: NDArray[np.float32]
    reranked: int | None
    finalists: int | None
    stored: int
    sample: CollectionSample | None
    density: LocalDensities | None

    def only(self, places: NDArray[np.intp]) -> "Candidates":
        """The candidates at some indices."""
        return replace(
            self,
            shapes=self.shapes[places],
            embeddings=self.embeddings[places],
            signatures=self.signatures[places],
            coarse_samples=self.coarse_samples[places],
            view_signatures=self.view_signatures[places],
            reliabilities=self.reliabilities[places],
        )


def candidates(container: Container, query: Query, options: Options) -> Candidates:
    """The shapes that match the filter, without the query itself, or a shortlist of them."""
    embedding = query.embedding
    wanted = options.sized(embedding.facts.area)
    with container.database.read() as session:
        stored = shapes_repository.stored(session, wanted.collection)
        sample = collection_sample(container, session, query.active_pipeline, wanted.collection)
        if container.settings.signatures == "database":
            entries, shortlisted = entries_in_database(
                session, query, wanted, options, stored, ef_search=HnswParameters().ef_search
            )
        else:
            entries, shortlisted = _in_memory(session, query, wanted, options, stored)
    if shortlisted:
        container.metrics.queries_shortlisted.inc()
    finalists = options.finalists + options.top_k
    return Candidates(
        shapes=entries.shapes,
        embeddings=entries.embeddings,
        signature=embedding.signature,
        # The index of an empty archive has signatures of length 0.
        signatures=entries.signatures.reshape(len(entries.shapes), len(embedding.signature)),
        coarse_samples=entries.coarse_samples,
        view_signatures=entries.view_signatures,
        reliabilities=entries.reliabilities,
        reranked=max(options.reranked, finalists) if shortlisted else None,
        finalists=finalists if shortlisted else None,
        stored=stored,
        sample=sample,
        density=None if sample is None else sample.of_query(query.descriptors),
    )


def _in_memory(
    session: ReadSession,
    query: Query,
    wanted: ShapeFilter,
    options: Options,
    stored: int,
) -> tuple[IndexEntries, bool]:
    """The candidates by the signatures in memory, and whether they are a shortlist."""
    entries = query.active_pipeline.index.current(session)
    chosen = entries.collections == wanted.collection
    lacking = stored - np.count_nonzero(chosen)
    if lacking > 0:
        log.info(
            "%d of %d stored shapes have no embedding by the active pipeline and are not searched",
            lacking,
            stored,
        )
    if not wanted.is_empty:
        matching = shapes_repository.numbers(session, wanted)
        chosen &= np.isin(entries.shapes, np.array(matching, dtype=np.int64))
    if options.exclude_self:
        for number in query.itself:
            chosen &= entries.shapes != number
    places = np.flatnonzero(chosen)
    shortlisted = not options.exhaustive and len(places) >= options.shortlist_from
    if shortlisted:
        places = _nearest(query, entries, places, options)
    if not shortlisted:
        entries = replace(entries, coarse_samples=np.empty((len(entries.shapes), 0), np.uint8))
    return entries.only(places), shortlisted


def _nearest(
    query: Query, entries: IndexEntries, places: NDArray[np.intp], options: Options
) -> NDArray[np.intp]:
    """The nearest of some entries by signatures, then further ones by view signatures.

    If log odds rank the answer, more of both are looked for, and those of greatest approximate log odds stay.
    """
    few = FEW * len(places) < len(entries.shapes)

    def nearest(distances: Callable[[NDArray[Any]], NDArray[Any]], of: NDArray[Any], count: int) -> Ints:
        # If most shapes match the filter, gathering their signatures takes longer than measuring all.
        found = distances(of[places]) if few else distances(of)[places]
        return places[least(found, entries.shapes[places], count)]

    by_signature = partial(signature_distances, query.embedding.signature)
    length, view = options.shortlist_length, query.view_signature
    by_views = partial(signature_distance, view)
    both = length + views_of(length)
    if not ranks_by_log_odds(options):
        chosen = nearest(by_signature, entries.signatures, length)
        alike = nearest(by_views, entries.view_signatures, both - length)
        return np.concatenate([chosen, alike[~np.isin(alike, chosen)]])
    found = np.union1d(
        nearest(by_signature, entries.signatures, WIDE * length),
        nearest(by_views, entries.view_signatures, WIDE * length),
    )
    return found[likeliest(query, entries.only(found), length)]
