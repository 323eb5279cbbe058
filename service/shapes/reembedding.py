"""Going over to another pipeline: its embeddings are made beside the old ones, then all queries change.

Each embedding is kept as soon as it is made, so that what is stopped, by whatever, goes on where it was.
"""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from core.errors import CoreError
from core.parameters import Parameters
from core.pipeline import Pipeline
from service.compute.tasks import Embedded
from service.compute.work import Work
from service.errors import ClusterUnavailableError, FileTimeLimitError, WorkerLostError
from service.observability.logging import get_logger
from service.pipelines import repository
from service.pipelines.active import keep
from service.shapes import repository as shapes_repository
from service.storage.database import Database

PRUNED_AT_ONCE = 200
# A worker that is lost may have been stopped for want of memory, and not because of the file.
TRIES = 2
# It may come back at any time, and nothing is lost by waiting.
CLUSTER_SECONDS = 5.0

log = get_logger("pipelines")

File = tuple[int, str]
"""The number of a blob, and the format that it is read in."""


@dataclass
class Outcome:
    """What came of it.

    Attributes
    ----------
    made : int
        Embeddings that this run made.
    refused : list
        The names of the shapes that have none, and why.
    active : bool
        Whether the archive is searched by the pipeline now.
    """

    made: int = 0
    refused: list[tuple[str, str]] = field(default_factory=list)
    active: bool = False


class Reembedding:
    """Has an archive embedded by a pipeline.

    Parameters
    ----------
    database : Database
    work : Work
        Does the embedding.
    parameters : Parameters
        Of the pipeline.
    """

    def __init__(self, database: Database, work: Work, parameters: Parameters) -> None:
        self._database = database
        self._work = work
        self._parameters = parameters
        self._pipeline = Pipeline(parameters)
        self._refused: dict[File, str] = {}

    def todo(self) -> list[File]:
        """The files that lack an embedding, without those that cannot have one."""
        with self._database.read() as session:
            found = repository.unembedded(session, self._pipeline.fingerprint)
        return [file for file in found if file not in self._refused]

    async def run(self, *, at_once: int, leave_out: bool, advance: Callable[[int, int], object]) -> Outcome:
        """Make the embeddings that are lacking, and have the archive searched by the pipeline.

        Parameters
        ----------
        at_once : int
            How many files are at work at a time.
        leave_out : bool
            Whether to go over to the pipeline though files cannot be embedded by it; no query finds them
            then.
        advance : callable
            Told how many files were done, and how many there were to do, whenever that changes.
        """
        outcome = Outcome()
        done = 0
        while not outcome.active:
            files = await asyncio.to_thread(self.todo)
            advance(done, done + len(files))
            waiting = iter(files)

            async def take(waiting: Iterator[File] = waiting, total: int = done + len(files)) -> None:
                nonlocal done
                for file in waiting:
                    made = await self._embed(file)
                    outcome.made += made
                    done += 1
                    advance(done, total)

            try:
                async with asyncio.TaskGroup() as group:
                    for _ in range(at_once):
                        group.create_task(take())
            except ExceptionGroup as several:
                raise several.exceptions[0] from None
            if self._refused and not leave_out:
                break
            outcome.active = await asyncio.to_thread(self._go_over)
        outcome.refused = await asyncio.to_thread(self._names_of_refused)
        return outcome

    def prune(self) -> int:
        """Delete the embeddings by other pipelines of what this one has embedded; how many there were."""
        deleted = 0
        while True:
            with self._database.write() as session:
                some = repository.prune(session, self._pipeline.fingerprint, PRUNED_AT_ONCE)
            deleted += some
            if not some:
                return deleted

    async def _embed(self, file: File) -> bool:
        """Embed a file, unless it has been deleted; whether that was done."""
        number, format = file
        read = await asyncio.to_thread(self._read, number)
        if read is None:
            return False
        sha256, data = read
        tries_left = TRIES
        while True:
            try:
                embedded = await self._work.embed(data, format, self._pipeline)
                break
            except ClusterUnavailableError as error:
                log.warning("waiting for the cluster: %s", error)
                await asyncio.sleep(CLUSTER_SECONDS)
            except (CoreError, FileTimeLimitError) as error:
                self._refused[file] = str(error)
                return False
            except WorkerLostError as error:
                tries_left -= 1
                if not tries_left:
                    self._refused[file] = str(error)
                    return False
        return await asyncio.to_thread(self._store, number, sha256, format, embedded)

    def _read(self, number: int) -> tuple[str, bytes] | None:
        with self._database.read() as session:
            return repository.blob(session, number)

    def _store(self, number: int, sha256: str, format: str, embedded: Embedded) -> bool:
        """Keep an embedding, unless the file has gone, or somebody else has embedded it."""
        fingerprint = self._pipeline.fingerprint
        with self._database.write() as session:
            wanted = repository.names(session, number, format)
            if not wanted or shapes_repository.is_embedded(session, fingerprint, sha256, format):
                return False
            shapes_repository.add_embedding(session, number, format, fingerprint, embedded)
            shapes_repository.look_again(session, number, format, embedded.facts)
            return True

    def _go_over(self) -> bool:
        """Have the archive searched by the pipeline, unless files came meanwhile that it has not embedded."""
        fingerprint = self._pipeline.fingerprint
        with self._database.write() as session:
            lacking = repository.unembedded(session, fingerprint)
            if any(file not in self._refused for file in lacking):
                return False
            keep(session, self._parameters)
            if repository.active(session) != fingerprint:
                repository.activate(session, fingerprint)
            return True

    def _names_of_refused(self) -> list[tuple[str, str]]:
        with self._database.read() as session:
            return [
                (name, cause)
                for (number, format), cause in sorted(self._refused.items())
                for name in repository.names(session, number, format)
            ]
