"""The active pipeline, with which the archive is searched; the settings may name another one."""

import threading
from dataclasses import dataclass

from core.arrays import Float32s
from core.parameters import Parameters
from core.pipeline import Pipeline
from service.errors import REEMBED
from service.index.cache import COLLECTIONS, CollectionSample, EmbeddingCache
from service.index.signature_table import SignatureTable
from service.observability.logging import get_logger
from service.pipelines import repository
from service.storage.database import Database, ReadSession
from service.storage.postgresql import ensure_hnsw

log = get_logger("pipelines")


@dataclass(frozen=True, eq=False)
class ActivePipeline:
    """A pipeline, the index of its signatures, and caches of its match records and samples.

    The key of a sample is the number of its collection; the revision of the archive stands beside it.
    """

    pipeline: Pipeline
    index: SignatureTable
    cache: EmbeddingCache[Float32s]
    samples: EmbeddingCache[tuple[int, CollectionSample]]

    @property
    def fingerprint(self) -> str:
        """The fingerprint of the pipeline."""
        return self.pipeline.fingerprint


class Pipelines:
    """The active pipeline, as the database names it: `isoshape reembed` may change it at any time.

    `wanted` has the parameters that the settings name; the cache of match records has at most `room` bytes.
    """

    def __init__(self, wanted: Parameters, *, room: int = 0) -> None:
        self.wanted = wanted
        self._room = room
        self._lock = threading.Lock()
        self._active: ActivePipeline | None = None

    def current(self, session: ReadSession) -> ActivePipeline:
        """Return the active pipeline, as the session sees it.

        Raise PipelineUnavailableError if a newer version of the service has activated a pipeline that this
        version does not have.
        """
        fingerprint = repository.active(session)
        assert fingerprint is not None
        with self._lock:
            if self._active is None or self._active.fingerprint != fingerprint:
                parameters = repository.parameters(session, fingerprint)
                if self._active is not None:
                    fields = {"pipeline": parameters.name, "fingerprint": fingerprint}
                    log.info("another pipeline is active now", extra={"fields": fields})
                self._active = ActivePipeline(
                    Pipeline(parameters),
                    SignatureTable(fingerprint),
                    EmbeddingCache(self._room),
                    EmbeddingCache(COLLECTIONS, lambda _: 1),
                )
            return self._active

    def pending(self, session: ReadSession) -> tuple[int, int] | None:
        """Return how many files the wanted pipeline has embedded, of how many, or None if it is active."""
        if repository.active(session) == self.wanted.fingerprint:
            return None
        return repository.count_embedded(session, self.wanted.fingerprint)

    @property
    def indexed(self) -> int:
        """The number of shapes in the index of the active pipeline, as of the last query."""
        active_pipeline = self._active
        return 0 if active_pipeline is None else len(active_pipeline.index)

    @property
    def cached_bytes(self) -> int:
        """The size of the cached match records, in bytes."""
        active_pipeline = self._active
        return 0 if active_pipeline is None else active_pipeline.cache.nbytes


def fingerprint(session: ReadSession) -> str:
    """Return the fingerprint of the active pipeline, even if this service does not have the pipeline."""
    active = repository.active(session)
    assert active is not None
    return active


def begin(pipelines: Pipelines, database: Database, *, in_memory: bool = True) -> None:
    """Adopt the active pipeline of the archive, or activate the wanted one if the archive is empty.

    A warning is logged if the settings name another pipeline. The HNSW index of signatures is built if it is
    missing or has other parameters. With `in_memory`, the signatures are read into memory. Raise
    PipelineUnavailableError if this version of the service does not have the active pipeline.
    """
    wanted = pipelines.wanted
    with database.write() as session:
        active = repository.active(session)
        if active is None or repository.is_empty(session):
            repository.keep(session, wanted)
            if active != wanted.fingerprint:
                repository.activate(session, wanted.fingerprint)
        ensure_hnsw(session, pipelines.current(session).fingerprint)
    with database.read() as session:
        active_pipeline = pipelines.current(session)
        if in_memory:
            active_pipeline.index.current(session)
        embedded, files = repository.count_embedded(session, active_pipeline.fingerprint)
    parameters = active_pipeline.pipeline.parameters
    fields: dict[str, object] = {"pipeline": parameters.name, "fingerprint": parameters.fingerprint}
    log.info("the active pipeline of the archive", extra={"fields": fields})
    if parameters.fingerprint != wanted.fingerprint:
        log.warning(
            "pipeline %s (%s) is active, not %s (%s) of the settings. %s",
            parameters.name,
            parameters.fingerprint,
            wanted.name,
            wanted.fingerprint,
            REEMBED,
        )
    if embedded < files:
        log.warning(
            "%d of %d files have no embedding by the active pipeline and are not searched: "
            "`isoshape reembed` computes the missing ones",
            files - embedded,
            files,
        )
