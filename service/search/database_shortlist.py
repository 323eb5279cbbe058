"""Shortlists from the database, without signatures in memory."""

from typing import TypedDict

import numpy as np

from core.arrays import Ints
from core.ranking.shortlist import least, signature_distances
from service.collection import CollectionNumber
from service.index.repository import IndexEntries, count_shapes, stacked, stacked_views
from service.search import pgvector_repository as repository
from service.search.coarse_log_odds import likeliest, ranks_by_log_odds
from service.search.records import Options, Query
from service.search.shortlist_length import views_of
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

CLOSE = 16
"""Additional neighbours, sorted again by distances in double precision: the database has single precision."""


def entries_in_database(
    session: ReadSession,
    query: Query,
    shapes: ShapeFilter,
    options: Options,
    stored: int,
    *,
    ef_search: int,
) -> tuple[IndexEntries, bool]:
    """The candidates of a query, and whether they are a shortlist.

    The HNSW index finds the shortlist if there is no filter and the collection has at least half of all
    shapes; otherwise exact search does, because most neighbours in the index would not match. Coarse samples
    are read only for a shortlist.

    Parameters
    ----------
    session : ReadSession
        A session of a PostgreSQL database.
    query : Query
    shapes : ShapeFilter
        The candidates.
    options : Options
    stored : int
        Number of shapes in the collection.
    ef_search : int
        See `service.search.pgvector_repository.nearest`.
    """
    fingerprint = query.active_pipeline.fingerprint
    itself = np.array(sorted(query.itself) if options.exclude_self else [], dtype=np.int64)
    if options.exhaustive or not repository.has_at_least(
        session, fingerprint, shapes, itself.tolist(), options.shortlist_from
    ):
        numbers, embeddings, signatures = repository.signatures(session, fingerprint, shapes)
        others = ~np.isin(numbers, itself)
        none = np.empty((len(numbers), 0), np.uint8)
        collections = np.full(len(numbers), shapes.collection, np.int64)
        unknown = np.full(len(numbers), np.nan, np.float32)
        found = IndexEntries(numbers, collections, embeddings, signatures, none, none, unknown)
        return found.only(others), False
    by_hnsw = shapes.is_empty and _is_half(session, shapes.collection, stored)
    how: _How = {"shapes": shapes, "ef_search": ef_search if by_hnsw else None}
    numbers, embeddings = _by_signature(session, query, options.shortlist_length, itself, how)
    by_log_odds = ranks_by_log_odds(options)
    length, both = options.shortlist_length, options.shortlist_length + views_of(options.shortlist_length)
    count = length if by_log_odds else both - length
    alike = repository.nearest_views(session, fingerprint, query.view_signature, count + len(itself), **how)
    places = np.flatnonzero(~np.isin(alike.shapes, itself))[:count]
    places = places[~np.isin(alike.shapes[places], numbers)]
    numbers = np.concatenate([numbers, alike.shapes[places]])
    embeddings = np.concatenate([embeddings, alike.embeddings[places]])
    entries = _entries(session, numbers, embeddings, shapes.collection)
    return entries.only(likeliest(query, entries, length)) if by_log_odds else entries, True


class _How(TypedDict):
    shapes: ShapeFilter
    ef_search: int | None


def _by_signature(
    session: ReadSession, query: Query, length: int, itself: Ints, how: _How
) -> tuple[Ints, Ints]:
    """The numbers of the shapes with the nearest signatures, and of their embeddings."""
    signature = query.embedding.signature
    found = repository.nearest(
        session, query.active_pipeline.fingerprint, signature, length + len(itself) + CLOSE, **how
    )
    others = ~np.isin(found.shapes, itself)
    numbers, embeddings = found.shapes[others], found.embeddings[others]
    known = repository.sketches(session, embeddings)
    signatures = stacked([known[number].signature for number in embeddings.tolist()]).view("<f4")
    nearest = least(signature_distances(signature, signatures), numbers, length)
    return numbers[nearest], embeddings[nearest]


def _entries(
    session: ReadSession, numbers: Ints, embeddings: Ints, collection: CollectionNumber
) -> IndexEntries:
    """The entries of some shapes."""
    known = repository.sketches(session, embeddings)
    found = [known[number] for number in embeddings.tolist()]
    return IndexEntries(
        numbers,
        np.full(len(numbers), collection, np.int64),
        embeddings,
        stacked([one.signature for one in found]).view("<f4"),
        stacked([one.coarse_samples for one in found]),
        stacked_views([one.view_signature for one in found]),
        np.array([one.reliability for one in found], dtype=np.float32),
    )


def _is_half(session: ReadSession, collection: CollectionNumber, stored: int) -> bool:
    """Whether a collection with `stored` shapes has at least half of all shapes."""
    return not shapes_repository.others_hold_shapes(session, collection) or 2 * stored >= count_shapes(
        session
    )
