"""Comparing a query with many stored embeddings."""

import asyncio
from collections.abc import Sequence

import numpy as np
from starlette.concurrency import run_in_threadpool

from service.logging import get_logger
from service.parts import Parts
from service.search import repository
from service.search.candidates import Candidates
from service.search.ranking import Compared
from service.search.records import Query
from service.storage.database import Database

log = get_logger("search")

CHUNK = 256


async def compare_with(parts: Parts, query: Query, candidates: Candidates) -> Compared:
    """Score the candidates: each embedding once, in chunks, of which a few are in memory at a time.

    A candidate that was deleted meanwhile, or whose record cannot be read, is left out.
    """
    pipeline = query.in_use.pipeline
    embeddings, places = np.unique(candidates.embeddings, return_inverse=True)
    length = max(1, min(CHUNK, -(-len(embeddings) // parts.settings.workers)))
    turns = asyncio.Semaphore(2 * parts.settings.workers)
    scores = np.full((3, len(embeddings)), np.nan)

    async def score(start: int) -> None:
        async with turns:
            wanted = embeddings[start : start + length].tolist()
            records = await run_in_threadpool(_read, parts.database, wanted)
            present = [start + i for i, number in enumerate(wanted) if number in records]
            found = await parts.work.score(
                query.record, [records[number] for number in wanted if number in records], pipeline
            )
            scores[:, present] = found.cc, found.ssd, found.sim

    try:
        async with asyncio.TaskGroup() as chunks:
            for start in range(0, len(embeddings), length):
                chunks.create_task(score(start))
    except ExceptionGroup as group:
        raise group.exceptions[0] from None
    cc, ssd, sim = scores[:, places]
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


def _read(database: Database, numbers: Sequence[int]) -> dict[int, bytes]:
    with database.read() as session:
        return repository.embedding_records(session, numbers)
