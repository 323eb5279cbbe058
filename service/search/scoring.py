"""Comparing a query with many stored embeddings."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.descriptors.descriptor_distance import is_part
from core.ranking.shortlist import least
from service.compute.workers import RemoteWorkers
from service.container import Container
from service.observability.logging import get_logger
from service.search import repository
from service.search.batches import by_threads, each_once, in_batches
from service.search.cluster_scoring import SENT as SPREAD
from service.search.cluster_scoring import cluster_scores
from service.search.match_records import Rows, Scores
from service.search.rank_by import RankBy
from service.search.ranking import Compared
from service.search.records import Query
from service.search.shortlist import Candidates
from service.search.spin_images import chances
from service.storage.database import Database

log = get_logger("search")

MATCHED, SIFTED, SENT = 32, 256, 256
"""How many embeddings a thread matches, or sifts, or a worker process is sent, at a time."""


async def compare_with(
    container: Container, query: Query, candidates: Candidates, rank_by: RankBy
) -> tuple[Compared, Candidates]:
    """Score the candidates, each embedding once, or those of them that sifting and screening put first.

    Where no shortlist is made and the workers are a cluster's, these match them.
    A candidate that was deleted meanwhile, or whose record cannot be read, is left out. The second that is
    returned are those that were scored, in the same order.
    """
    with container.searches.one():
        return await _compared(container, query, candidates, rank_by)


async def _compared(
    container: Container, query: Query, candidates: Candidates, rank_by: RankBy
) -> tuple[Compared, Candidates]:
    pipeline = query.active_pipeline.pipeline
    if pipeline.parameters.matching.pairs == "both-ways":
        rows = await run_in_threadpool(Rows, container.database, query)
        candidates = await _finalists(container, query, rows, candidates, rank_by)
        score, at_once = by_threads(container, rows.matched), MATCHED
        if candidates.finalists is None and isinstance(container.pool, RemoteWorkers):
            score, at_once = (
                partial(cluster_scores, container, container.pool, query.active_pipeline, rows.query),
                SPREAD,
            )
    else:
        score, at_once = partial(_by_worker, container, query), SENT
    scores = await each_once(container, candidates, at_once, 3, score)
    known = np.isfinite(scores).all(axis=0)
    if not known.all():
        log.warning("%d candidates were deleted meanwhile, or cannot be read", np.count_nonzero(~known))
    candidates, (cc, ssd, sim) = candidates.only(np.flatnonzero(known)), scores[:, known]
    combined = await chances(container, query, candidates, cc, sim) if rank_by == "combined" else None
    return Compared(candidates.shapes, cc, ssd, sim, combined), candidates


async def _finalists(
    container: Container, query: Query, rows: Rows, candidates: Candidates, rank_by: RankBy
) -> Candidates:
    """Those that are matched in full: first the sketches are sifted, then what is left is screened.

    Each step leaves those of greatest CC as far as it tells, or of greatest chance where that is asked. An
    incomplete query's chance hangs on patches most of all, which sifting does not look at: all are screened.
    """
    by_chance = rank_by == "combined"
    sifting = not (by_chance and is_part(query.spin_images))
    if sifting and candidates.reranked is not None and candidates.reranked < len(candidates.shapes):
        sifted = by_threads(container, rows.sifted)
        rough = (await in_batches(candidates.coarse_samples, SIFTED, container.settings.workers, 1, sifted))[
            0
        ]
        if by_chance:
            rough = query.active_pipeline.pipeline.combined(
                rough, np.zeros(len(rough)), candidates.signature, candidates.signatures
            )
        candidates = _likeliest(candidates, rough, candidates.reranked)
    if candidates.finalists is not None and candidates.finalists < len(candidates.shapes):
        rough = (await each_once(container, candidates, MATCHED, 1, by_threads(container, rows.screened)))[0]
        if by_chance:
            rough = await chances(container, query, candidates, rough, np.zeros(len(rough)))
        candidates = _likeliest(candidates, rough, candidates.finalists)
    return candidates


def _likeliest(candidates: Candidates, likeness: NDArray[np.float64], count: int) -> Candidates:
    """The candidates of greatest likeness; those gone are last."""
    return candidates.only(least(np.nan_to_num(-likeness, nan=np.inf), candidates.shapes, count))


async def _by_worker(container: Container, query: Query, embeddings: NDArray[np.int64]) -> Scores:
    """CC, SSD and sim, by a worker process: shape (3, c), NaN for those that are gone."""
    numbers = embeddings.tolist()
    records = await run_in_threadpool(_read, container.database, numbers)
    present = [place for place, number in enumerate(numbers) if number in records]
    found = await container.work.score(
        query.record, [records[numbers[place]] for place in present], query.active_pipeline.pipeline
    )
    scores = np.full((3, len(numbers)), np.nan)
    scores[:, present] = found.cc, found.ssd, found.sim
    return scores


def _read(database: Database, numbers: Sequence[int]) -> dict[int, bytes]:
    with database.read() as session:
        return repository.embedding_records(session, numbers)
