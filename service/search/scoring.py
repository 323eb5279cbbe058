"""The scores of a query with its candidates."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Floats, Ints
from core.descriptors.partial import is_part
from core.ranking.differences import TYPICAL_SIM
from core.ranking.shortlist import least
from service.container import Container
from service.observability.logging import get_logger
from service.search import repository
from service.search.batches import by_embedding, by_threads, in_batches
from service.search.class_probability import class_scores, coarse_class_scores
from service.search.match_records import QueryScorer
from service.search.rank_by import RankBy
from service.search.ranking import Compared
from service.search.records import Query
from service.search.shortlist import Candidates
from service.storage.database import Database

log = get_logger("search")

THREAD_BATCH, COARSE_BATCH, PROCESS_BATCH = 48, 256, 256
"""Embeddings that a thread scores in full, or ranks coarsely, or that a worker process scores, at a time."""

DESCRIBED = 0.5
"""Share of the re-ranked candidates whose descriptors are read, if class scores rank the answer."""

PART_FACTOR = 2
"""Factor of the number of re-ranked candidates of an incomplete query. Descriptors of all of them are read,
since the class score depends mostly on spin images."""


async def compare_with(
    container: Container, query: Query, candidates: Candidates, rank_by: RankBy
) -> tuple[Compared, Candidates]:
    """Score the candidates, each embedding matched once.

    Of a shortlist, only the first after the coarse ranking and the re-ranking are scored. Deleted and
    unreadable candidates are left out. The second result is the candidates that were scored, in the same
    order.
    """
    with container.searches.running():
        return await _compared(container, query, candidates, rank_by)


async def _compared(
    container: Container, query: Query, candidates: Candidates, rank_by: RankBy
) -> tuple[Compared, Candidates]:
    if query.active_pipeline.pipeline.matcher.uses_match_records:
        scorer = await run_in_threadpool(QueryScorer, container.database, query)
        candidates = await _finalists(container, query, scorer, candidates, rank_by)
        score, batch = by_threads(container, scorer.score), THREAD_BATCH
    else:
        score, batch = partial(_by_worker, container, query), PROCESS_BATCH
    scores = await by_embedding(container, candidates, batch, 3, score)
    known = np.isfinite(scores).all(axis=0)
    if not known.all():
        log.warning("%d candidates were deleted meanwhile, or cannot be read", np.count_nonzero(~known))
    candidates, (cc, ssd, sim) = candidates.only(np.flatnonzero(known)), scores[:, known]
    combined = await class_scores(container, query, candidates, cc, sim) if rank_by == "combined" else None
    return Compared(candidates.shapes, cc, ssd, sim, combined), candidates


async def _finalists(
    container: Container, query: Query, scorer: QueryScorer, candidates: Candidates, rank_by: RankBy
) -> Candidates:
    """The candidates that are scored in full: the first after the coarse ranking and the re-ranking.

    Each step keeps the candidates of greatest approximate CC, or of greatest class score if the answer
    is ranked by it. Approximate class scores choose the re-ranked candidates whose descriptors are read.
    """
    by_probability = rank_by == "combined"
    part = by_probability and is_part(query.spin_images)
    reranked = candidates.reranked
    if part and reranked is not None:
        reranked *= PART_FACTOR
    if reranked is not None and reranked < len(candidates.shapes):
        score = by_threads(container, scorer.rank_coarsely)
        workers = container.settings.workers
        rough = (await in_batches(candidates.coarse_samples, COARSE_BATCH, workers, 1, score))[0]
        if by_probability:
            rough = await run_in_threadpool(coarse_class_scores, query, candidates, rough)
        candidates = candidates.only(_greatest(candidates, rough, reranked))
    finalists = candidates.finalists
    if finalists is not None and finalists < len(candidates.shapes):
        score = by_threads(container, scorer.rerank)
        rough = (await by_embedding(container, candidates, THREAD_BATCH, 1, score))[0]
        if by_probability and not part:
            described = max(finalists, math.ceil(len(rough) * DESCRIBED))
            first = _greatest(candidates, coarse_class_scores(query, candidates, rough), described)
            candidates, rough = candidates.only(first), rough[first]
        if by_probability:
            sim = np.full(len(rough), TYPICAL_SIM)
            rough = await class_scores(container, query, candidates, rough, sim)
        candidates = candidates.only(_greatest(candidates, rough, finalists))
    return candidates


def _greatest(candidates: Candidates, scores: Floats, count: int) -> NDArray[np.intp]:
    """Indices of the candidates of greatest score; deleted ones come last."""
    return least(np.nan_to_num(-scores, nan=np.inf), candidates.shapes, count)


async def _by_worker(container: Container, query: Query, embeddings: Ints) -> Floats:
    """CC, SSD and sim, by a worker process: shape (3, c), NaN for the deleted ones."""
    numbers = embeddings.tolist()
    records = await run_in_threadpool(_read, container.database, numbers)
    present = [place for place, number in enumerate(numbers) if number in records]
    found = await container.queue.score(
        query.record, [records[numbers[place]] for place in present], query.active_pipeline.pipeline
    )
    scores = np.full((3, len(numbers)), np.nan)
    scores[:, present] = found.cc, found.ssd, found.sim
    return scores


def _read(database: Database, numbers: Sequence[int]) -> dict[int, bytes]:
    with database.read() as session:
        return repository.embedding_records(session, numbers)
