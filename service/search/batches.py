"""Scores of many stored shapes, a few pieces of them at a time."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.compute.work import short_of_memory
from service.container import Container
from service.search.match_records import Scores
from service.search.shortlist import Candidates


async def each_once(
    container: Container,
    candidates: Candidates,
    at_once: int,
    kinds: int,
    score: Callable[[NDArray[Any]], Awaitable[Scores]],
) -> Scores:
    """The scores of the candidates, shape (kinds, c), of which several may have one embedding."""
    embeddings, places = np.unique(candidates.embeddings, return_inverse=True)
    return (await in_batches(embeddings, at_once, container.settings.workers, kinds, score))[:, places]


def by_threads(
    container: Container, score: Callable[[NDArray[Any]], Scores]
) -> Callable[[NDArray[Any]], Awaitable[Scores]]:
    """The function, run by the threads that compare."""

    async def scores(piece: NDArray[Any]) -> Scores:
        with short_of_memory():
            return await asyncio.wrap_future(container.threads.submit(score, piece))

    return scores


async def in_batches(
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
