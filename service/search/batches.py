"""Scores of many stored shapes, computed in batches."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from service.compute.request_queue import short_of_memory
from service.container import Container
from service.search.shortlist import Candidates


async def by_embedding(
    container: Container,
    candidates: Candidates,
    length: int,
    kinds: int,
    score: Callable[[NDArray[Any]], Awaitable[Floats]],
) -> Floats:
    """The scores of the candidates, shape (kinds, c); an embedding that several share is scored once."""
    embeddings, places = np.unique(candidates.embeddings, return_inverse=True)
    return (await in_batches(embeddings, length, container.settings.workers, kinds, score))[:, places]


def by_threads(
    container: Container, score: Callable[[NDArray[Any]], Floats]
) -> Callable[[NDArray[Any]], Awaitable[Floats]]:
    """The function, run by the threads that score."""

    async def scores(batch: NDArray[Any]) -> Floats:
        with short_of_memory():
            return await asyncio.wrap_future(container.threads.submit(score, batch))

    return scores


async def in_batches(
    whole: NDArray[Any],
    length: int,
    workers: int,
    kinds: int,
    score: Callable[[NDArray[Any]], Awaitable[Floats]],
) -> Floats:
    """The scores of an array of c rows, shape (kinds, c), computed in batches, two a worker at a time.

    The batches have at most `length` rows. All have the same number, but for the last, and there are about as
    many for each worker, so that the workers end together.
    """
    count = workers * max(1, math.ceil(len(whole) / (workers * length)))
    length = max(1, math.ceil(len(whole) / count))
    free = asyncio.Semaphore(2 * workers)
    scores = np.full((kinds, len(whole)), np.nan)

    async def score_batch(start: int) -> None:
        async with free:
            scores[:, start : start + length] = await score(whole[start : start + length])

    try:
        async with asyncio.TaskGroup() as batches:
            for start in range(0, len(whole), length):
                batches.create_task(score_batch(start))
    except ExceptionGroup as group:
        raise group.exceptions[0] from None
    return scores
