"""The pipeline that the archive is searched by, which is not always the one that the settings name."""

import threading
from dataclasses import dataclass

from core.arrays import Float32s
from core.errors import ParameterError
from core.parameters import DEFAULT, EARLIER_VALUES, METHOD_VERSION, PAPER, Parameters
from core.pipeline import Pipeline
from service.errors import PipelineUnavailableError
from service.index.cache import EmbeddingCache
from service.index.signature_index import SignatureIndex
from service.observability.logging import get_logger
from service.pipelines import repository
from service.pipelines.repository import Written
from service.storage.database import ReadSession, WriteSession

log = get_logger("pipelines")

REMEDY = "run `isoshape reembed` on the archive"


@dataclass(frozen=True, eq=False)
class ActivePipeline:
    """A pipeline, the signatures of what it has embedded, and what of that is ready to be compared."""

    pipeline: Pipeline
    index: SignatureIndex
    cache: EmbeddingCache[Float32s]

    @property
    def fingerprint(self) -> str:
        """Of the pipeline."""
        return self.pipeline.fingerprint


@dataclass(frozen=True)
class Pending:
    """The pipeline that the settings name, while the archive is searched by another.

    `embedded` of `files` have an embedding of it; shapes on the same bytes are one file.
    """

    name: str
    fingerprint: str
    embedded: int
    files: int


class Pipelines:
    """Follows the database in which pipeline is used: `isoshape reembed` may change that at any time.

    Parameters
    ----------
    wanted : Parameters
        Those that the settings name.
    room : int
        Bytes that may be kept of embeddings ready to be compared.
    """

    def __init__(self, wanted: Parameters, *, room: int = 0) -> None:
        self.wanted = wanted
        self._room = room
        self._lock = threading.Lock()
        self._active: ActivePipeline | None = None

    def begin(self, session: WriteSession) -> None:
        """Take up the pipeline that the archive has; the wanted one where nothing is stored.

        Raises
        ------
        PipelineUnavailableError
            This version of the service cannot make such embeddings, nor compare them.
        """
        fingerprint = repository.active(session)
        if fingerprint is None or repository.is_empty(session):
            keep(session, self.wanted)
            if fingerprint != self.wanted.fingerprint:
                repository.activate(session, self.wanted.fingerprint)
        for known in (self.wanted, DEFAULT, PAPER):
            if known.fingerprint == fingerprint:
                keep(session, known)
        self.current(session)

    def current(self, session: ReadSession) -> ActivePipeline:
        """What the archive is searched by, as the session sees it.

        Raises
        ------
        PipelineUnavailableError
            A newer version of the service has taken it over meanwhile.
        """
        fingerprint = repository.active(session)
        assert fingerprint is not None
        with self._lock:
            if self._active is None or self._active.fingerprint != fingerprint:
                parameters = _parameters(fingerprint, repository.written(session, fingerprint))
                if self._active is not None:
                    fields = {"pipeline": parameters.name, "fingerprint": fingerprint}
                    log.info("the archive is searched by another pipeline now", extra={"fields": fields})
                self._active = ActivePipeline(
                    Pipeline(parameters), SignatureIndex(fingerprint), EmbeddingCache(self._room)
                )
            return self._active

    def pending(self, session: ReadSession) -> Pending | None:
        """The wanted pipeline, unless it is in use."""
        if repository.active(session) == self.wanted.fingerprint:
            return None
        embedded, files = repository.count_embedded(session, self.wanted.fingerprint)
        return Pending(self.wanted.name, self.wanted.fingerprint, embedded, files)

    @property
    def indexed(self) -> int:
        """How many shapes are in the index in use, as of the last query."""
        active_pipeline = self._active
        return 0 if active_pipeline is None else len(active_pipeline.index)

    @property
    def cached_bytes(self) -> int:
        """How many bytes are kept of embeddings ready to be compared."""
        active_pipeline = self._active
        return 0 if active_pipeline is None else active_pipeline.cache.nbytes


def fingerprint(session: ReadSession) -> str:
    """Of the pipeline that the archive is searched by, whether or not this service knows it."""
    active = repository.active(session)
    assert active is not None
    return active


def keep(session: WriteSession, parameters: Parameters) -> None:
    """Have the archive know what a pipeline is."""
    repository.write(session, parameters.fingerprint, Written(METHOD_VERSION, parameters.flat()))


def _parameters(fingerprint: str, written: Written | None) -> Parameters:
    """The parameters with a fingerprint."""
    if written is None:
        raise PipelineUnavailableError(
            f"the archive was embedded by pipeline {fingerprint}, of another version of the method or of "
            "parameters that Isoshape 0.1 did not write down. Start with the ISOSHAPE_PIPELINE that made it, "
            f"or {REMEDY}"
        )
    if written.method != METHOD_VERSION:
        raise PipelineUnavailableError(
            f"the archive was embedded by version {written.method} of the method, and this Isoshape has "
            f"version {METHOD_VERSION}: use the Isoshape that embedded it, or {REMEDY}"
        )
    try:
        parameters = Parameters.from_values({**EARLIER_VALUES, **written.parameters})
    except ParameterError:
        parameters = None
    if parameters is None or parameters.fingerprint != fingerprint:
        raise PipelineUnavailableError(
            "the archive was embedded with parameters that this Isoshape does not have: use the Isoshape "
            f"that embedded it, or {REMEDY}"
        )
    return parameters
