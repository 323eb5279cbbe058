"""The heavy work as the rest of the service sees it: awaited, bounded, and in the service's own errors."""

import asyncio
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager

from core.embedding import Match, Scores
from core.pipeline import Pipeline
from core.reading import Limits
from service.compute.tasks import Embedded, embed_file, match_records, score_records
from service.errors import BusyError, FileTimeLimitError, TaskTimeLimitError


class Work:
    """Embedding and comparing with one pipeline.

    Parameters
    ----------
    executor : Executor
        Where it is done.
    pipeline : Pipeline
        The workers make their own from its parameters.
    limits : Limits
        What a file may hold.
    workers : int
        How many tasks the executor does at a time.
    waiting : int
        How many more requests may wait for it.
    """

    def __init__(
        self, executor: Executor, pipeline: Pipeline, limits: Limits, *, workers: int, waiting: int
    ) -> None:
        self.pipeline = pipeline
        self._executor = executor
        self._limits = limits
        self._room = workers + waiting
        self._inside = 0

    @property
    def inside(self) -> int:
        """How many requests are at work or wait."""
        return self._inside

    @property
    def room(self) -> int:
        """How many may be."""
        return self._room

    @contextmanager
    def admitted(self) -> Iterator[None]:
        """Count a request in, and out at the end.

        Raises
        ------
        BusyError
            As many as may be are at work or waiting.
        """
        if self._inside >= self._room:
            raise BusyError(f"{self._inside} requests are at work or waiting; try again later")
        self._inside += 1
        try:
            yield
        finally:
            self._inside -= 1

    async def embed(self, data: bytes, format: str) -> Embedded:
        """Read a file and embed its mesh."""
        task = self._executor.submit(embed_file, data, format, self._limits, self.pipeline.parameters)
        try:
            return await asyncio.wrap_future(task)
        except TaskTimeLimitError as error:
            raise FileTimeLimitError(str(error)) from error

    async def score(self, query: bytes, records: Sequence[bytes]) -> Scores:
        """How alike the query is to each of c records: arrays of shape (c,), NaN where one cannot be read."""
        return await asyncio.wrap_future(
            self._executor.submit(score_records, query, records, self.pipeline.parameters)
        )

    async def match(self, first: bytes, second: bytes) -> Match:
        """Compare two records."""
        return await asyncio.wrap_future(
            self._executor.submit(match_records, first, second, self.pipeline.parameters)
        )
