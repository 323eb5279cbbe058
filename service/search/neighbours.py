"""The graph of neighbours: how its rows are compared, and the order that they lend to candidates."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Ints
from core.ranking.diffusion import (
    MOST_NODES,
    NEIGHBOURS,
    NOBODY,
    NeighbourRows,
    contextual_scores,
    unreached_scores,
)
from core.ranking.shortlist import least
from service.collection import CollectionNumber
from service.container import Container
from service.index.neighbour_repository import Compared, neighbour_rows
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.caches import CandidateReader
from service.search.records import MatchedCandidates, Query
from service.search.scoring import Cascade, coarse_log_odds, find_candidates
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

SHORTLIST_FROM = 64
"""Shapes of a collection from which a row is made from a shortlist."""

ROW_CANDIDATES = 150
"""Most candidates of a row whose points are compared: those of greatest coarse log odds."""

LEAST_KNOWN = 0.5
"""The least share of the likeliest candidates that have rows, for the graph to order an answer."""

FIRST = 64
"""Number of the likeliest candidates of which the share is taken."""


@dataclass(frozen=True, eq=False)
class RowsAround(NeighbourRows):
    """The graph around some shapes; `known`, shape (n,), tells which have a row."""

    known: NDArray[np.bool_]


async def likeliest(
    container: Container,
    active_pipeline: ActivePipeline,
    collection: CollectionNumber,
    shape: int,
    embedding: int,
) -> Compared:
    """Compare a stored shape, given by number as its embedding, with the likeliest others of its collection.

    An embedding that cannot be read is compared with none.
    """
    records = await container.database.reading(repository.embedding_records, [embedding])
    compared, log_odds = np.empty(0, np.int64), np.empty(0)
    if embedding in records:
        query = Query(
            records[embedding], active_pipeline=active_pipeline, excluded=frozenset([shape]), number=embedding
        )
        cascade = Cascade(container, query, CandidateReader(container, active_pipeline), by_log_odds=True)
        candidates = await run_in_threadpool(
            find_candidates, container, query, ShapeFilter(collection), SHORTLIST_FROM, by_log_odds=True
        )
        if len(candidates) > ROW_CANDIDATES:
            likely = -coarse_log_odds(query, candidates.entries)
            candidates = candidates.only(least(likely, candidates.entries.shapes, ROW_CANDIDATES))
        if len(candidates):
            matched = await cascade.score(candidates, NEIGHBOURS)
            assert matched.log_odds is not None
            compared, log_odds = matched.candidates.entries.shapes, matched.log_odds
    return Compared(shape, embedding, compared, log_odds)


def in_context(session: ReadSession, query: Query, matched: MatchedCandidates) -> MatchedCandidates:
    """Return matched candidates, which have log odds, with contextual scores if the graph has enough rows.

    The graph is that of the likeliest candidates and, as room is left, of their neighbours, which may match
    no filter: flow passes through them.
    """
    assert matched.log_odds is not None
    shapes, fingerprint = matched.candidates.entries.shapes, query.active_pipeline.fingerprint
    best = least(-matched.log_odds, shapes, MOST_NODES)
    rows = rows_around(session, fingerprint, shapes[best], without=query.excluded)
    indices = np.searchsorted(rows.shapes, shapes[best])
    if len(best) and rows.known[indices[:FIRST]].mean() < LEAST_KNOWN:
        return matched
    log_odds = np.full(len(rows.shapes), -np.inf)
    log_odds[indices] = matched.log_odds[best]
    contextual = unreached_scores(matched.log_odds)
    contextual[best] = contextual_scores(rows, log_odds)[indices]
    return replace(matched, contextual=contextual)


def rows_around(
    session: ReadSession, fingerprint: str, shapes: Ints, *, without: Collection[int]
) -> RowsAround:
    """Return the rows of some shapes, at most `MOST_NODES`, and of their neighbours as room is left.

    Shapes that have no row have an empty one; other neighbours without a row, or in `without`, are not there.
    """
    own = neighbour_rows(session, fingerprint, shapes)
    further = np.setdiff1d(own.neighbours, [NOBODY, *without, *shapes.tolist()])
    others = neighbour_rows(session, fingerprint, further[: max(MOST_NODES - len(shapes), 0)])
    return _rows_of(np.union1d(shapes, others.shapes), own, others)


def rows_among(session: ReadSession, fingerprint: str, shapes: Ints) -> NeighbourRows | None:
    """Return the rows of some shapes, as `rows_of` does; None if most are unknown."""
    rows = rows_of(session, fingerprint, shapes)
    return rows if len(shapes) and rows.known.mean() >= LEAST_KNOWN else None


def rows_of(session: ReadSession, fingerprint: str, shapes: Ints) -> RowsAround:
    """Return the rows of some shapes, given in ascending order; empty where they are unknown."""
    return _rows_of(shapes, neighbour_rows(session, fingerprint, shapes))


def _rows_of(numbers: Ints, *parts: NeighbourRows) -> RowsAround:
    """Return the rows of some shapes, ascending, from several."""
    neighbours = np.full((len(numbers), NEIGHBOURS), NOBODY)
    log_odds = np.full((len(numbers), NEIGHBOURS), -np.inf)
    known = np.zeros(len(numbers), dtype=bool)
    for part in parts:
        indices = np.searchsorted(numbers, part.shapes)
        neighbours[indices], log_odds[indices], known[indices] = part.neighbours, part.log_odds, True
    return RowsAround(numbers, neighbours, log_odds, known)
