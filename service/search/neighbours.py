"""The graph of neighbours: its rows are made one by one, and lend an order to the candidates of a query."""

from dataclasses import replace

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.arrays import Floats, Ints
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
from service.index import neighbour_repository
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.caches import CandidateReader
from service.search.records import MatchedCandidates, Query
from service.search.scoring import Cascade, find_candidates
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

SHORTLIST_FROM = 64
"""Shapes of a collection from which a row is made from a shortlist."""

LEAST_KNOWN = 0.5
"""The least share of the likeliest candidates that have rows, for the graph to order an answer."""

FIRST = 64
"""Number of the likeliest candidates of which the share is taken."""


async def make_row(
    container: Container,
    active_pipeline: ActivePipeline,
    collection: CollectionNumber,
    shape: int,
    embedding: int,
) -> None:
    """Compare a stored shape with the likeliest others of its collection, and store its nearest neighbours.

    The shape and its embedding are given by number. An embedding that cannot be read has no neighbours.
    """
    records = await container.database.reading(repository.embedding_records, [embedding])
    compared, log_odds = np.empty(0, np.int64), np.empty(0)
    if embedding in records:
        query = Query(
            records[embedding],
            active_pipeline=active_pipeline,
            excluded=frozenset([shape]),
            number=embedding,
        )
        cascade = Cascade(container, query, CandidateReader(container, active_pipeline), by_log_odds=True)
        candidates = await run_in_threadpool(
            find_candidates, container, query, ShapeFilter(collection), SHORTLIST_FROM, by_log_odds=True
        )
        if len(candidates):
            matched = await cascade.score(candidates, NEIGHBOURS)
            assert matched.log_odds is not None
            compared, log_odds = matched.candidates.entries.shapes, matched.log_odds
    fingerprint = active_pipeline.fingerprint
    await container.database.writing(
        neighbour_repository.write, fingerprint, (shape, embedding), compared, log_odds
    )


def in_context(session: ReadSession, query: Query, matched: MatchedCandidates) -> MatchedCandidates:
    """Return matched candidates, which have log odds, with contextual scores if the graph has enough rows.

    The graph is that of the likeliest candidates and, as room is left, of their neighbours, which may match
    no filter: flow passes through them.
    """
    assert matched.log_odds is not None
    shapes, fingerprint = matched.candidates.entries.shapes, query.active_pipeline.fingerprint
    best = least(-matched.log_odds, shapes, MOST_NODES)
    rows = neighbour_repository.neighbour_rows(session, fingerprint, shapes[best])
    first = shapes[best[:FIRST]]
    if np.isin(first, rows.shapes).sum() < LEAST_KNOWN * len(first):
        return matched
    further = np.setdiff1d(rows.neighbours, [NOBODY, *query.excluded, *shapes.tolist()])
    room = max(MOST_NODES - len(best), 0)
    around = neighbour_repository.neighbour_rows(session, fingerprint, further[:room])
    nodes = np.union1d(shapes[best], around.shapes)
    log_odds = np.full(len(nodes), -np.inf)
    log_odds[np.searchsorted(nodes, shapes[best])] = matched.log_odds[best]
    scores = contextual_scores(_of_nodes(nodes, rows, around), log_odds)
    contextual = unreached_scores(matched.log_odds)
    contextual[best] = scores[np.searchsorted(nodes, shapes[best])]
    return replace(matched, contextual=contextual)


def _of_nodes(nodes: Ints, *parts: NeighbourRows) -> NeighbourRows:
    """Return the rows of some shapes, ascending, from several; those that have none are empty."""
    neighbours = np.full((len(nodes), NEIGHBOURS), NOBODY)
    log_odds: Floats = np.full((len(nodes), NEIGHBOURS), -np.inf)
    for part in parts:
        indices = np.searchsorted(nodes, part.shapes)
        neighbours[indices], log_odds[indices] = part.neighbours, part.log_odds
    return NeighbourRows(nodes, neighbours, log_odds)
