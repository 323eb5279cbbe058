"""Comparing a query with many stored embeddings where a cluster's workers keep them."""

import asyncio
from functools import partial

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.arrays import Float32s
from service.compute.work import short_of_memory
from service.compute.workers import RemoteWorkers
from service.container import Container
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.worker_scoring import match_kept

Scores = NDArray[np.float64]

SENT = 1_024
"""How many embeddings are asked for at a time."""

TOGETHER = 64
"""Embeddings of so many numbers in turn are kept by one worker."""


async def cluster_scores(
    container: Container,
    pool: RemoteWorkers,
    active_pipeline: ActivePipeline,
    query: Float32s,
    embeddings: NDArray[np.int64],
) -> Scores:
    """CC, SSD and sim of c embeddings by number: shape (3, c), NaN for those that are gone.

    Each worker matches those that fall to it, and is sent the records of those that it does not keep yet.

    Raises
    ------
    ClusterUnavailableError
        The scheduler is away, or has no workers.
    """
    owners = pool.owners(embeddings // TOGETHER)
    scores = np.full((3, len(embeddings)), np.nan)

    async def owned(owner: str) -> None:
        places = np.flatnonzero(owners == owner)
        scores[:, places], missing = await _asked(
            container, pool, active_pipeline, owner, query, embeddings[places], {}
        )
        if len(missing):
            records = await run_in_threadpool(_read, container, missing.tolist())
            places = np.flatnonzero(np.isin(embeddings, missing))
            scores[:, places], _ = await _asked(
                container, pool, active_pipeline, owner, query, embeddings[places], records
            )

    try:
        async with asyncio.TaskGroup() as group:
            for owner in np.unique(owners).tolist():
                group.create_task(owned(owner))
    except ExceptionGroup as failed:
        raise failed.exceptions[0] from None
    return scores


async def _asked(
    container: Container,
    pool: RemoteWorkers,
    active_pipeline: ActivePipeline,
    owner: str,
    query: Float32s,
    numbers: NDArray[np.int64],
    records: dict[int, bytes],
) -> tuple[Scores, NDArray[np.int64]]:
    """The scores of what a worker keeps, and the numbers of what it does not."""
    call = partial(pool.submit_to, owner, match_kept, query, numbers, records)
    with short_of_memory():
        task = call(active_pipeline.pipeline.parameters, pool.user, container.settings.search_bytes)
        found: tuple[Scores, NDArray[np.int64]] = await asyncio.wrap_future(task)
        return found


def _read(container: Container, numbers: list[int]) -> dict[int, bytes]:
    with container.database.read() as session:
        return repository.embedding_records(session, numbers)
