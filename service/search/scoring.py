"""The scores of a query with its candidates, in batches on the threads of the service.

The cascade: coarse ranking by the coarse samples in memory; re-ranking by quantised points; the full match.
Each step passes the best on. The first two run for a shortlist only.
"""

import asyncio
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Floats, Ints
from core.descriptors.partial import is_part
from core.descriptors.registry import ShapeDescriptors
from core.embedding import Scores
from core.matching.match_records import match_record, score_match_records
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import TYPICAL_SIM, differences_of
from core.ranking.reranking import coarse_ranking, rerank
from core.ranking.shortlist import least
from service.compute.request_queue import short_of_memory
from service.container import Container
from service.observability.logging import get_logger
from service.search.caches import CandidateReader
from service.search.records import Candidates, MatchedCandidates, Query
from service.search.schemas import RankBy
from service.search.shortlist import coarse_log_odds

log = get_logger("search")

MATCH_BATCH, DESCRIPTOR_BATCH, COARSE_BATCH, PROCESS_BATCH = 48, 64, 256, 256
"""Most embeddings that a thread matches, compares by descriptors or ranks coarsely at a time, and that a
worker process matches."""

DESCRIBED = 0.5
"""Share of the re-ranked candidates whose descriptors are read, if log odds rank the answer."""

PART_FACTOR = 2
"""Factor of the number of re-ranked candidates of an incomplete query. Descriptors of all of them are read,
since the log odds depend mostly on spin images."""


async def score_candidates(
    container: Container,
    query: Query,
    reader: CandidateReader,
    candidates: Candidates,
    rank_by: RankBy,
    top_k: int,
) -> MatchedCandidates:
    """Match the candidates, each embedding once; of a shortlist, only the best of the earlier stages.

    Deleted and unreadable candidates are left out. The matches have log odds if these rank the answer.

    Parameters
    ----------
    rank_by : RankBy
        The score that ranks the answer. Approximate CC stands for cc, ssd and sim in the earlier stages.
    top_k : int
        The number of results; the full match has as many more candidates as the setting of finalists says.
    """
    by_log_odds, settings = rank_by == "combined", container.settings
    has_records = query.active_pipeline.pipeline.matcher.uses_match_records
    with container.searches.running():
        record = await run_in_threadpool(_match_record, query) if has_records else None
        if record is not None and candidates.shortlisted:
            finalists = settings.finalists + top_k
            reranked = max(settings.reranked, finalists)
            if by_log_odds and is_part(query.spin_images):
                reranked *= PART_FACTOR
            if reranked < len(candidates):
                candidates = await _rank_coarsely(
                    container, query, record, candidates, reranked, by_log_odds=by_log_odds
                )
            if finalists < len(candidates):
                candidates = await _rerank(
                    container, query, reader, record, candidates, finalists, by_log_odds=by_log_odds
                )
        if record is not None:
            match = partial(_match, query, reader, record, candidates, by_log_odds)
            scores = await by_embedding(container, candidates, match, MATCH_BATCH, 4)
        else:
            match_in_worker = partial(_match_in_worker, container, query, reader, candidates, by_log_odds)
            scores = await by_embedding(
                container, candidates, match_in_worker, PROCESS_BATCH, 4, on_threads=False
            )
    known = np.asarray(np.isfinite(scores[:3]).all(axis=0))
    if not known.all():
        log.warning("%d candidates were deleted meanwhile, or cannot be read", np.count_nonzero(~known))
    cc, ssd, sim, log_odds = scores
    return MatchedCandidates(candidates, cc, ssd, sim, log_odds if by_log_odds else None).only(known)


def class_log_odds(
    query: Query,
    candidates: Candidates,
    embeddings: list[int],
    described: dict[int, ShapeDescriptors],
    cc: Floats,
    sim: Floats,
) -> Floats:
    """Compute the log odds that a query and each of c embeddings are of one class, shape (c,).

    They are the least for embeddings without descriptors or CC, which were deleted meanwhile.

    Parameters
    ----------
    query : Query
    candidates : Candidates
        Local densities are those in their sample; without one, typical.
    embeddings : list of int
        Numbers of c embeddings.
    described : dict
        Descriptors by number.
    cc, sim : float64, shape (c,)
    """
    present = [i for i, number in enumerate(embeddings) if number in described and not np.isnan(cc[i])]
    log_odds = np.full(len(embeddings), -np.inf)
    if not present:
        return log_odds
    numbers = [embeddings[i] for i in present]
    shapes = [described[number] for number in numbers]
    densities = None if candidates.sample is None else candidates.sample.of_stored(numbers, shapes)
    scores = Scores(cc[present], np.zeros(len(present)), sim[present])
    differences = differences_of(query.descriptors, shapes, scores, candidates.density, densities)
    log_odds[present] = pooled_log_odds(differences)
    return log_odds


def _match_record(query: Query) -> NDArray[np.float32]:
    """Return the match record of the query, cached if the query is a stored shape."""
    active_pipeline = query.active_pipeline
    cached = {} if query.number is None else active_pipeline.cache.get([query.number])
    if query.number in cached:
        return cached[query.number]
    return match_record(query.embedding, active_pipeline.pipeline.parameters)


async def _rank_coarsely(
    container: Container,
    query: Query,
    record: NDArray[np.float32],
    candidates: Candidates,
    count: int,
    *,
    by_log_odds: bool,
) -> Candidates:
    """Return the best candidates by their coarse samples, and by coarse log odds if these rank the answer."""
    coarse_samples, parameters = candidates.entries.coarse_samples, query.active_pipeline.pipeline.parameters

    def rank(batch: NDArray[np.uint8]) -> Floats:
        return coarse_ranking(record, batch, parameters)[None].astype(np.float64)

    (cc,) = await _in_batches(container, rank, coarse_samples, COARSE_BATCH, 1)
    scores = await run_in_threadpool(coarse_log_odds, query, candidates.entries, cc) if by_log_odds else cc
    return candidates.only(_best(candidates, scores, count))


async def _rerank(
    container: Container,
    query: Query,
    reader: CandidateReader,
    record: NDArray[np.float32],
    candidates: Candidates,
    count: int,
    *,
    by_log_odds: bool,
) -> Candidates:
    """Return the best candidates by their points, and by descriptors if log odds rank the answer.

    Scores come from the points even if match records are cached: an answer never depends on the cache. Coarse
    log odds choose the candidates whose descriptors are read; of an incomplete query, all are.
    """
    parameters = query.active_pipeline.pipeline.parameters

    def match_points(batch: Ints) -> Floats:
        numbers = batch.tolist()
        points = reader.points(numbers)
        present = [i for i, number in enumerate(numbers) if number in points]
        scores = np.full((1, len(numbers)), np.nan)
        scores[0, present] = rerank(record, [points[numbers[i]] for i in present], parameters)
        return scores

    (cc,) = await by_embedding(container, candidates, match_points, MATCH_BATCH, 1)
    if not by_log_odds:
        return candidates.only(_best(candidates, cc, count))
    if not is_part(query.spin_images):
        described = max(count, math.ceil(len(cc) * DESCRIBED))
        indices = _best(candidates, coarse_log_odds(query, candidates.entries, cc), described)
        candidates, cc = candidates.only(indices), cc[indices]
    entries = candidates.entries

    def compare_descriptors(batch: NDArray[np.intp]) -> Floats:
        numbers = entries.embeddings[batch].tolist()
        sim = np.full(len(batch), TYPICAL_SIM)
        described = reader.descriptors(numbers)
        return class_log_odds(query, candidates, numbers, described, cc[batch], sim)[None]

    indices = np.arange(len(cc))
    (log_odds,) = await _in_batches(container, compare_descriptors, indices, DESCRIPTOR_BATCH, 1)
    return candidates.only(_best(candidates, log_odds, count))


def _match(
    query: Query,
    reader: CandidateReader,
    record: NDArray[np.float32],
    candidates: Candidates,
    by_log_odds: bool,
    embeddings: Ints,
) -> Floats:
    """Match c embeddings by their records: CC, SSD, sim and, where asked for, log odds, shape (4, c)."""
    numbers = embeddings.tolist()
    match_records, described = reader.match_records(numbers, descriptors=by_log_odds)
    present = [i for i, number in enumerate(numbers) if number in match_records]
    parameters = query.active_pipeline.pipeline.parameters
    matched = score_match_records(record, [match_records[numbers[i]] for i in present], parameters)
    scores = np.full((4, len(numbers)), np.nan)
    scores[:3, present] = matched.cc, matched.ssd, matched.sim
    if by_log_odds:
        scores[3] = class_log_odds(query, candidates, numbers, described, scores[0], scores[2])
    return scores


async def _match_in_worker(
    container: Container,
    query: Query,
    reader: CandidateReader,
    candidates: Candidates,
    by_log_odds: bool,
    embeddings: Ints,
) -> Floats:
    """Match c embeddings in a worker process, for pipelines without match records, as `_match` does."""
    numbers = embeddings.tolist()
    records = await run_in_threadpool(reader.records, numbers)
    present = [i for i, number in enumerate(numbers) if number in records]
    matched = await container.queue.score(
        query.record, [records[numbers[i]] for i in present], query.active_pipeline.pipeline
    )
    scores = np.full((4, len(numbers)), np.nan)
    scores[:3, present] = matched.cc, matched.ssd, matched.sim
    if by_log_odds:
        described = await run_in_threadpool(reader.descriptors, numbers)
        scores[3] = await run_in_threadpool(
            class_log_odds, query, candidates, numbers, described, scores[0], scores[2]
        )
    return scores


def _best(candidates: Candidates, scores: Floats, count: int) -> NDArray[np.intp]:
    """Return the indices of the candidates of greatest score; deleted ones come last."""
    return least(np.nan_to_num(-scores, nan=np.inf), candidates.entries.shapes, count)


async def by_embedding(
    container: Container,
    candidates: Candidates,
    score: Callable[[Ints], Any],
    length: int,
    kinds: int,
    *,
    on_threads: bool = True,
) -> Floats:
    """Score c candidates as `_in_batches` does, shape (kinds, c); a shared embedding is scored once."""
    embeddings, rows = np.unique(candidates.entries.embeddings, return_inverse=True)
    scores = await _in_batches(container, score, embeddings, length, kinds, on_threads=on_threads)
    return scores[:, rows]


async def _in_batches(
    container: Container,
    score: Callable[[NDArray[Any]], Any],
    rows: NDArray[Any],
    length: int,
    kinds: int,
    *,
    on_threads: bool = True,
) -> Floats:
    """Score c rows in batches, two a worker at a time, and return the scores, shape (kinds, c).

    `score` computes the scores of some rows on a thread, or is a coroutine function unless `on_threads`.
    The batches have at most `length` rows. All have the same number, but for the last, and there are about as
    many for each worker, so that the workers end together. If the query is cancelled, or a batch fails,
    batches that have not begun are cancelled.
    """
    workers = container.settings.workers
    count = workers * max(1, math.ceil(len(rows) / (workers * length)))
    length = max(1, math.ceil(len(rows) / count))
    batches: dict[asyncio.Future[Floats], int] = {}
    pending: set[asyncio.Future[Floats]] = set()
    try:
        with short_of_memory():
            for start in range(0, len(rows), length):
                if len(pending) == 2 * workers:
                    done, pending = await asyncio.wait(pending, return_when=asyncio.FIRST_COMPLETED)
                    for batch in done:
                        batch.result()
                part = rows[start : start + length]
                if on_threads:
                    batch = asyncio.wrap_future(container.threads.submit(score, part))
                else:
                    batch = asyncio.ensure_future(score(part))
                batches[batch] = start
                pending.add(batch)
            await asyncio.gather(*pending)
    finally:
        for batch in pending:
            batch.cancel()
    scores = np.empty((kinds, len(rows)))
    for batch, start in batches.items():
        scores[:, start : start + length] = batch.result()
    return scores
