"""Comparing a query with many stored embeddings."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.signatures import least
from service.compute.work import short_of_memory
from service.compute.workers import PlacedWorkers
from service.logging import get_logger
from service.parts import Parts
from service.search import repository
from service.search.candidates import Candidates
from service.search.ranking import Compared, RankBy
from service.search.records import Query
from service.search.rows import Rows, Scores
from service.search.spread import SENT as SPREAD
from service.search.spread import spread_scores
from service.storage.database import Database

log = get_logger("search")

MATCHED, SIFTED, SENT = 32, 256, 256
"""How many embeddings a thread matches, or sifts, or a worker process is sent, at a time."""


async def compare_with(parts: Parts, query: Query, candidates: Candidates, rank_by: RankBy) -> Compared:
    """Score the candidates, each embedding once, or those of them that sifting and screening put first.

    Where no shortlist is made and the workers are a cluster's, these match them.
    A candidate that was deleted meanwhile, or whose record cannot be read, is left out.
    """
    with parts.searches.one():
        return await _compared(parts, query, candidates, rank_by)


async def _compared(parts: Parts, query: Query, candidates: Candidates, rank_by: RankBy) -> Compared:
    pipeline = query.in_use.pipeline
    if pipeline.parameters.pairs == "both-ways":
        rows = await run_in_threadpool(Rows, parts.database, query)
        candidates = await _finalists(parts, query, rows, candidates, rank_by)
        score, at_once = _in(parts, rows.matched), MATCHED
        if candidates.finalists is None and isinstance(parts.pool, PlacedWorkers):
            score, at_once = partial(spread_scores, parts, parts.pool, query.in_use, rows.query), SPREAD
    else:
        score, at_once = partial(_by_worker, parts, query), SENT
    scores = await _each_once(parts, candidates, at_once, 3, score)
    cc, ssd, sim = scores
    known = np.isfinite(cc) & np.isfinite(ssd) & np.isfinite(sim)
    if not known.all():
        log.warning("%d candidates were deleted meanwhile, or cannot be read", np.count_nonzero(~known))
    return Compared(
        shapes=candidates.shapes[known],
        cc=cc[known],
        ssd=ssd[known],
        sim=sim[known],
        combined=pipeline.combined(cc[known], sim[known], candidates.signature, candidates.signatures[known]),
    )


async def _finalists(
    parts: Parts, query: Query, rows: Rows, candidates: Candidates, rank_by: RankBy
) -> Candidates:
    """Those that are matched in full: first the sketches are sifted, then what is left is screened.

    Each step leaves those of greatest CC as far as it tells, or of greatest chance where that is asked.
    """
    if candidates.screened is not None and candidates.screened < len(candidates.shapes):
        sifted = _in(parts, rows.sifted)
        rough = await _in_pieces(candidates.sketches, SIFTED, parts.settings.workers, 1, sifted)
        candidates = _likeliest(query, candidates, rough[0], candidates.screened, rank_by)
    if candidates.finalists is not None and candidates.finalists < len(candidates.shapes):
        rough = await _each_once(parts, candidates, MATCHED, 1, _in(parts, rows.screened))
        candidates = _likeliest(query, candidates, rough[0], candidates.finalists, rank_by)
    return candidates


def _likeliest(
    query: Query, candidates: Candidates, rough: NDArray[np.float64], count: int, rank_by: RankBy
) -> Candidates:
    """The candidates of greatest CC, or of greatest chance where that is asked; those gone are last."""
    likeness = rough
    if rank_by == "combined":
        unknown = np.zeros(len(rough))
        likeness = query.in_use.pipeline.combined(rough, unknown, candidates.signature, candidates.signatures)
    return candidates.only(least(np.nan_to_num(-likeness, nan=np.inf), candidates.shapes, count))


async def _each_once(
    parts: Parts,
    candidates: Candidates,
    at_once: int,
    kinds: int,
    score: Callable[[NDArray[Any]], Awaitable[Scores]],
) -> Scores:
    """The scores of the candidates, shape (kinds, c), of which several may have one embedding."""
    embeddings, places = np.unique(candidates.embeddings, return_inverse=True)
    return (await _in_pieces(embeddings, at_once, parts.settings.workers, kinds, score))[:, places]


def _in(parts: Parts, score: Callable[[NDArray[Any]], Scores]) -> Callable[[NDArray[Any]], Awaitable[Scores]]:
    """The function, run by the threads that compare."""

    async def scores(piece: NDArray[Any]) -> Scores:
        with short_of_memory():
            return await asyncio.wrap_future(parts.threads.submit(score, piece))

    return scores


async def _by_worker(parts: Parts, query: Query, embeddings: NDArray[np.int64]) -> Scores:
    """CC, SSD and sim, by a worker process: shape (3, c), NaN for those that are gone."""
    numbers = embeddings.tolist()
    records = await run_in_threadpool(_read, parts.database, numbers)
    present = [place for place, number in enumerate(numbers) if number in records]
    found = await parts.work.score(
        query.record, [records[numbers[place]] for place in present], query.in_use.pipeline
    )
    scores = np.full((3, len(numbers)), np.nan)
    scores[:, present] = found.cc, found.ssd, found.sim
    return scores


async def _in_pieces(
    whole: NDArray[Any],
    length: int,
    workers: int,
    kinds: int,
    score: Callable[[NDArray[Any]], Awaitable[Scores]],
) -> Scores:
    """The scores of an array of c rows, shape (kinds, c), of which a few pieces are at work at a time."""
    length = max(1, min(length, -(-len(whole) // workers)))
    turns = asyncio.Semaphore(2 * workers)
    scores = np.full((kinds, len(whole)), np.nan)

    async def piece(start: int) -> None:
        async with turns:
            scores[:, start : start + length] = await score(whole[start : start + length])

    try:
        async with asyncio.TaskGroup() as pieces:
            for start in range(0, len(whole), length):
                pieces.create_task(piece(start))
    except ExceptionGroup as group:
        raise group.exceptions[0] from None
    return scores


def _read(database: Database, numbers: Sequence[int]) -> dict[int, bytes]:
    with database.read() as session:
        return repository.embedding_records(session, numbers)
