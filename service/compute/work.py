"""The heavy work as the rest of the service sees it: awaited, bounded, and in the service's own errors."""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from core.embedding import Match, Scores
from core.errors import MalformedMeshError, MeshTooComplexError
from core.io import Limits
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from service.compute.sandbox import Readable, read_file
from service.compute.tasks import Embedded, embed_mesh, match_embeddings, score_embeddings
from service.errors import (
    BusyError,
    FileTimeLimitError,
    TaskTimeLimitError,
    WorkerCrashedError,
    WorkerLostError,
)

P = ParamSpec("P")
R = TypeVar("R")


class Work:
    """Embedding and comparing, each time with the pipeline that is asked for.

    Parameters
    ----------
    executor : Executor
        Where it is done, but for the reading of files.
    readers : Executor
        Where files are read: processes that `sandbox.enter` has confined.
    limits : Limits
        What a file may hold.
    read_seconds : float
        The processor time that reading a file may take.
    workers : int
        How many tasks the executor does at a time.
    waiting : int
        How many more requests may wait for it.
    """

    def __init__(
        self,
        executor: Executor,
        readers: Executor,
        limits: Limits,
        *,
        read_seconds: float,
        workers: int,
        waiting: int,
    ) -> None:
        self._executor = executor
        self._readers = readers
        self._limits = limits
        self._read_seconds = read_seconds
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

    async def embed(self, data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        """Read a file and embed its mesh."""
        with _at_fault():
            # No name is kept for the mesh, so that it goes once a worker has it.
            return await self._embedding(await self._reading(data, format), pipeline)

    async def score(self, query: bytes, records: Sequence[bytes], pipeline: Pipeline) -> Scores:
        """How alike the query is to each of c records: arrays of shape (c,), NaN where one cannot be read."""
        with short_of_memory():
            return await asyncio.wrap_future(
                self._executor.submit(score_embeddings, query, records, pipeline.parameters)
            )

    async def match(self, first: bytes, second: bytes, pipeline: Pipeline) -> Match:
        """Compare two records."""
        with short_of_memory():
            return await asyncio.wrap_future(
                self._executor.submit(match_embeddings, first, second, pipeline.parameters)
            )

    async def read(self, data: bytes, format: str) -> Mesh:
        """Read the mesh of a file."""
        with _at_fault():
            return (await self._reading(data, format)).mesh

    async def do(self, function: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
        """What a function, which the workers import by its name, makes of the arguments."""
        with _at_fault():
            return await asyncio.wrap_future(self._executor.submit(function, *arguments, **named))

    async def _reading(self, data: bytes, format: str) -> Readable:
        try:
            return await asyncio.wrap_future(
                self._readers.submit(read_file, data, format, self._limits, self._read_seconds)
            )
        except WorkerCrashedError as error:
            # It would again: to be told to try again would only end more of them.
            raise MalformedMeshError("what reads such files broke down over this one") from error

    def _embedding(self, read: Readable, pipeline: Pipeline) -> asyncio.Future[Embedded]:
        return asyncio.wrap_future(
            self._executor.submit(embed_mesh, read.mesh, pipeline.parameters, read.milliseconds)
        )


@contextmanager
def _at_fault() -> Iterator[None]:
    """What takes too much for one file, that file is refused for."""
    try:
        yield
    except TaskTimeLimitError as error:
        raise FileTimeLimitError(str(error)) from error
    except MemoryError as error:
        raise MeshTooComplexError("the mesh takes more memory than there is") from error


@contextmanager
def short_of_memory() -> Iterator[None]:
    """What is stored could be compared once, and can be again: no fault of the request.

    Raises
    ------
    WorkerLostError
        In the place of `MemoryError`.
    """
    try:
        yield
    except MemoryError as error:
        raise WorkerLostError("a worker has too little memory now; try again") from error
