"""Re-embedding of an archive by another pipeline: new embeddings are added, then the pipeline is activated.

Each embedding is stored as soon as it is computed, so that an interrupted run can be continued.
"""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from core.errors import CoreError
from core.parameters import Parameters
from core.pipeline import Pipeline
from service.compute.request_queue import RequestQueue, together
from service.compute.tasks import Embedded
from service.errors import ClusterUnavailableError, FileTimeLimitError, WorkerLostError
from service.observability.logging import get_logger
from service.pipelines import repository
from service.shapes import file_repository
from service.shapes import repository as shapes_repository
from service.storage.database import Database, ReadSession, WriteSession

PRUNED_AT_ONCE = 200
# Lack of memory, rather than the file, may have killed a worker.
TRIES = 2
# Waiting for a lost cluster costs nothing.
CLUSTER_SECONDS = 5.0

log = get_logger("pipelines")

File = tuple[int, str]
"""The number of a blob, and its format."""


@dataclass
class ReembeddingResult:
    """The result of a run: how many embeddings it computed, and whether the pipeline is active now.

    `refused` has the names of the shapes without an embedding, each with the reason; `changed` tells whether
    the run activated the pipeline.
    """

    made: int = 0
    refused: list[tuple[str, str]] = field(default_factory=list)
    active: bool = False
    changed: bool = False


class Reembedding:
    """Embeds the files of a database by the pipeline with some parameters, and activates it."""

    def __init__(self, database: Database, work: RequestQueue, parameters: Parameters) -> None:
        self._database = database
        self._work = work
        self._parameters = parameters
        self._pipeline = Pipeline(parameters)
        self._refused: dict[File, str] = {}

    async def run(
        self, *, at_once: int, leave_out: bool, advance: Callable[[int, int], object]
    ) -> ReembeddingResult:
        """Compute the missing embeddings and activate the pipeline.

        Parameters
        ----------
        at_once : int
            Number of files that are embedded at a time.
        leave_out : bool
            Whether to activate the pipeline although it refuses some files; queries then miss these.
        advance : callable
            Called with the number of finished files and of all files whenever one of them changes.
        """
        result = ReembeddingResult()
        done = 0
        while not result.active:
            files = await self._database.reading(self._todo)
            advance(done, done + len(files))

            async def take(waiting: Iterator[File], total: int) -> None:
                nonlocal done
                for file in waiting:
                    # Others count while this one waits.
                    made = await self._embed(file)
                    result.made += made
                    done += 1
                    advance(done, total)

            waiting, total = iter(files), done + len(files)
            await together(take(waiting, total) for _ in range(at_once))
            if self._refused and not leave_out:
                break
            result.active, result.changed = await self._database.writing(self._activate)
        result.refused = await self._database.reading(self._names_of_refused)
        return result

    async def _embed(self, file: File) -> bool:
        """Embed a file and store its embedding, unless it was deleted; return whether it was stored."""
        number, format = file
        tries_left = TRIES
        while True:
            try:
                blob = await self._database.reading(repository.blob, number)
                if blob is None:
                    return False
                embedded = await self._work.embed(blob[1], format, self._pipeline)
                return await self._database.writing(self._store, number, blob[0], format, embedded)
            except ClusterUnavailableError as error:
                log.warning("waiting for the cluster: %s", error)
                await asyncio.sleep(CLUSTER_SECONDS)
            except (CoreError, FileTimeLimitError, WorkerLostError) as error:
                tries_left -= 1
                if not tries_left or not isinstance(error, WorkerLostError):
                    self._refused[file] = str(error)
                    return False

    def _todo(self, session: ReadSession) -> list[File]:
        """Return the files without an embedding, except those that the pipeline refused."""
        files = repository.unembedded(session, self._pipeline.fingerprint)
        return [file for file in files if file not in self._refused]

    def _store(
        self, session: WriteSession, number: int, sha256: str, format: str, embedded: Embedded
    ) -> bool:
        """Store an embedding, unless the file was deleted or has one; return whether it was stored."""
        fingerprint = self._pipeline.fingerprint
        wanted = repository.names(session, number, format)
        if not wanted or file_repository.is_embedded(session, fingerprint, sha256, format):
            return False
        file_repository.add_embedding(session, number, format, fingerprint, embedded)
        shapes_repository.mark_changed(session, number, format, embedded.facts)
        return True

    def _activate(self, session: WriteSession) -> tuple[bool, bool]:
        """Activate the pipeline if all files are embedded; return whether it is active now, and newly so."""
        fingerprint = self._pipeline.fingerprint
        if self._todo(session):
            return False, False
        repository.keep(session, self._parameters)
        changed = repository.active(session) != fingerprint
        if changed:
            repository.activate(session, fingerprint)
        return True, changed

    def _names_of_refused(self, session: ReadSession) -> list[tuple[str, str]]:
        return [
            (name, cause)
            for (number, format), cause in sorted(self._refused.items())
            for name in repository.names(session, number, format)
        ]


def prune_others(database: Database, fingerprint: str) -> int:
    """Delete embeddings by other pipelines of files that one pipeline has embedded; how many."""
    deleted = 0
    while True:
        with database.write() as session:
            pruned = repository.prune(session, fingerprint, PRUNED_AT_ONCE)
        deleted += pruned
        if not pruned:
            return deleted
