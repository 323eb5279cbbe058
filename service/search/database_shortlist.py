"""Shortlists from the database, without signatures in memory."""

import numpy as np
from numpy.typing import NDArray

from core.ranking.shortlist import least, signature_distances
from service.collection import CollectionNumber
from service.index.repository import IndexEntries, count_shapes, stacked
from service.search import pgvector_repository as repository
from service.search.records import Options, Query
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

CLOSE = 16
"""Additional neighbours, sorted again by distances in double precision: the database has single precision."""


def entries_in_database(
    session: ReadSession,
    query: Query,
    signature: NDArray[np.float32],
    shapes: ShapeFilter,
    options: Options,
    stored: int,
    *,
    ef_search: int,
) -> tuple[IndexEntries, bool]:
    """The candidates of a query, and whether they are a shortlist; a shortlist has the nearest first.

    The HNSW index finds the shortlist if there is no filter and the collection has at least half of all
    shapes; otherwise exact search does, because most neighbours in the index would not match. Coarse samples
    are read only for a shortlist.

    Parameters
    ----------
    session : ReadSession
        A session of a PostgreSQL database.
    query : Query
    signature : float32, shape (s,)
        The signature of the query.
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
        return IndexEntries(numbers, collections, embeddings, signatures, none).only(others), False
    by_hnsw = shapes.is_empty and _is_half(session, shapes.collection, stored)
    found = repository.nearest(
        session,
        fingerprint,
        signature,
        options.shortlist_length + len(itself) + CLOSE,
        shapes=shapes,
        ef_search=ef_search if by_hnsw else None,
    )
    others = ~np.isin(found.shapes, itself)
    numbers, embeddings = found.shapes[others], found.embeddings[others]
    known = repository.entries(session, embeddings)
    signatures = stacked([known[number][0] for number in embeddings.tolist()]).view("<f4")
    nearest = least(signature_distances(signature, signatures), numbers, options.shortlist_length)
    coarse_samples = stacked([known[number][1] for number in embeddings[nearest].tolist()])
    collections = np.full(len(nearest), shapes.collection, np.int64)
    return IndexEntries(
        numbers[nearest], collections, embeddings[nearest], signatures[nearest], coarse_samples
    ), True


def _is_half(session: ReadSession, collection: CollectionNumber, stored: int) -> bool:
    """Whether a collection with `stored` shapes has at least half of all shapes."""
    return not shapes_repository.others_hold_shapes(session, collection) or 2 * stored >= count_shapes(
        session
    )
