"""Scoring spread over the workers of a cluster, each of which caches its share of the embeddings."""

import asyncio
from functools import partial

import numpy as np
from starlette.concurrency import run_in_threadpool

from core.arrays import Float32s, Floats, Ints
from service.compute.request_queue import short_of_memory
from service.compute.workers_interface import RemoteWorkers
from service.container import Container
from service.pipelines.active import ActivePipeline
from service.search import repository
from service.search.worker_scoring import score_on_worker

CLUSTER_BATCH = 1_024
"""Embeddings scored at a time."""

TOGETHER = 64
"""Consecutive numbers of embeddings that one worker caches."""


async def cluster_scores(
    container: Container,
    pool: RemoteWorkers,
    active_pipeline: ActivePipeline,
    query: Float32s,
    embeddings: Ints,
) -> Floats:
    """CC, SSD and sim of c embeddings by number: shape (3, c), NaN for the deleted ones.

    Each worker scores its share, and is sent the records of embeddings that it does not cache yet.

    Parameters
    ----------
    query : float32, shape (l,)
        A match record.
    embeddings : int64, shape (c,)

    Raises
    ------
    ClusterUnavailableError
        The scheduler cannot be reached, or has no workers.
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
    numbers: Ints,
    records: dict[int, bytes],
) -> tuple[Floats, Ints]:
    """The scores of the embeddings that a worker caches, and the numbers of those that it lacks."""
    call = partial(pool.submit_to, owner, score_on_worker, query, numbers, records)
    with short_of_memory():
        task = call(active_pipeline.pipeline.parameters, pool.user, container.settings.search_bytes)
        found: tuple[Floats, Ints] = await asyncio.wrap_future(task)
        return found


def _read(container: Container, numbers: list[int]) -> dict[int, bytes]:
    with container.database.read() as session:
        return repository.embedding_records(session, numbers)
